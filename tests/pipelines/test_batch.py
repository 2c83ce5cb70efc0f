from __future__ import annotations

import os
from pathlib import Path

import pytest

from deshake.errors import OutputError, PhotoError
from deshake.pipelines.batch import Job, PlanError, find_photos, plan, run
from deshake.pipelines.pair_deblurring import PairRestorationOptions
from deshake.pipelines.stages import EstimateOptions


@pytest.fixture(autouse=True)
def _files(tmp_path, monkeypatch):
    """Put some names into the current folder, which is the test's."""
    monkeypatch.chdir(tmp_path)
    for name in ("a.jpg", "b.PNG", "in/z.jpg", "in/y.tif", "in/a.txt", "in/d/q.jpg"):
        path = Path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)


def paths(*names):
    return [Path(name) for name in names]


def outputs(jobs):
    return [job.output.as_posix() for job in jobs]


def test_folders_are_searched_by_name_and_not_below():
    found = find_photos(paths("b.PNG", "in", "missing.jpg"))
    assert found == paths("b.PNG", "in/y.tif", "in/z.jpg", "missing.jpg")


def test_results_hidden_files_and_folders_are_no_photos():
    for name in ("in/z.deshaken.jpg", "in/.x.jpg"):
        Path(name).touch()
    Path("in/folder.jpg").mkdir()
    assert find_photos(paths("in")) == paths("in/y.tif", "in/z.jpg")


def test_a_folder_without_photos_is_an_error():
    Path("in/d/q.jpg").unlink()
    with pytest.raises(PhotoError, match="no photos in this folder"):
        find_photos(paths("a.jpg", "in/d"))


def test_one_photo_goes_beside_itself_to_a_file_or_into_a_folder():
    assert outputs(plan(paths("in/z.jpg"))) == ["in/z.deshaken.jpg"]
    assert outputs(plan(paths("a.jpg"), Path("x.jpg"))) == ["x.jpg"]
    assert outputs(plan(paths("a.jpg"), Path("in"))) == ["in/a.deshaken.jpg"]


def test_several_go_to_a_folder_that_is_made():
    jobs = plan(paths("a.jpg", "in"), Path("out"), Path("kernels"))
    assert outputs(jobs) == ["out/a.deshaken.jpg", "out/y.deshaken.tif", "out/z.deshaken.jpg"]
    assert [job.kernel for job in jobs] == [Path(f"kernels/{s}.kernel.npz") for s in "ayz"]
    assert all(job.problem is None for job in jobs)
    assert Path("out").is_dir()
    assert Path("kernels").is_dir()


def test_a_folder_of_one_goes_to_a_folder():
    assert outputs(plan(paths("in/d"), Path("out"))) == ["out/q.deshaken.jpg"]


def test_results_of_one_name_are_refused_and_nothing_is_made():
    Path("in/d/a.jpg").touch()
    with pytest.raises(PlanError, match=r"a\.jpg and in/d/a\.jpg would both"):
        plan(paths("a.jpg", "in/d"), Path("out"))
    with pytest.raises(PlanError, match="would both"):
        plan(paths("a.jpg", "./in/../a.jpg"))
    assert not Path("out").exists()


def test_kernels_of_one_name_are_refused():
    Path("a.png").touch()
    assert len(plan(paths("a.jpg", "a.png"))) == 2
    with pytest.raises(PlanError, match=r"a\.kernel\.npz"):
        plan(paths("a.jpg", "a.png"), keep_kernels=Path("k"))


def test_several_do_not_go_to_a_file_or_to_standard_output():
    with pytest.raises(PlanError, match=r"b\.PNG is a file"):
        plan(paths("a.jpg", "in"), Path("b.PNG"))
    with pytest.raises(PlanError, match="standard output"):
        plan(paths("a.jpg"), Path("-"))


def test_folders_that_cannot_be_made():
    with pytest.raises(OutputError, match="cannot be made: no such file"):
        plan(paths("a.jpg", "in"), Path("x/y"))
    with pytest.raises(OutputError, match="is not a folder"):
        plan(paths("a.jpg"), keep_kernels=Path("b.PNG"))


def test_a_problem_stands_in_its_job_alone():
    Path("a.deshaken.jpg").touch()
    one, two = plan(paths("a.jpg", "b.PNG"))
    assert "exists already" in str(one.problem)
    assert two.problem is None
    with pytest.raises(OutputError, match="exists already"):
        run(one, EstimateOptions())
    assert all(job.problem is None for job in plan(paths("a.jpg", "b.PNG"), overwrite=True))


def test_existing_results_are_skipped():
    Path("a.deshaken.jpg").touch()
    Path("k").mkdir()
    Path("k/b.kernel.npz").touch()
    one, two = plan(paths("a.jpg", "b.PNG"), keep_kernels=Path("k"), skip_existing=True)
    assert (one.skipped, two.skipped) == (True, False)
    assert (two.problem, two.overwrite, two.overwrite_others) == (None, False, True)
    assert run(one, EstimateOptions()) is None


@pytest.mark.parametrize("skip_existing", [False, True])
@pytest.mark.parametrize("link", [os.symlink, os.link])
def test_no_result_is_an_input_under_any_name(link, skip_existing):
    link("b.PNG", "a.deshaken.jpg")
    options = {"skip_existing": skip_existing, "overwrite": not skip_existing}
    one, two = plan(paths("a.jpg", "b.PNG"), **options)
    assert "never touches" in str(one.problem)
    assert two.problem is None


def test_a_noisy_photo_goes_with_one_photo():
    [job] = plan(paths("a.jpg"), noisy=Path("b.PNG"))
    assert (job.source, job.noisy, job.problem) == (Path("a.jpg"), Path("b.PNG"), None)
    for inputs in (paths("a.jpg", "in/z.jpg"), paths("in/d")):
        with pytest.raises(PlanError, match="one noisy photo goes with one blurred photo"):
            plan(inputs, noisy=Path("b.PNG"))
    for noisy in (Path("a.jpg"), Path("in/../a.jpg")):
        with pytest.raises(PlanError, match="is the photo itself"):
            plan(paths("a.jpg"), noisy=noisy)


def test_the_noisy_photo_is_never_replaced():
    [job] = plan(paths("a.jpg"), Path("in/../b.PNG"), noisy=Path("b.PNG"), overwrite=True)
    assert "the output is the input itself" in str(job.problem)


def test_a_noisy_photo_and_how_to_use_it_come_together():
    alone, pair = (Job(Path("a.jpg"), Path("x.jpg"), noisy=n) for n in (None, Path("b.PNG")))
    with pytest.raises(TypeError):
        run(pair, EstimateOptions())
    with pytest.raises(TypeError):
        run(alone, EstimateOptions(), restoration=PairRestorationOptions())
