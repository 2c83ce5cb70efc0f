from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from deshake.batch.name_template import NameTemplate
from deshake.batch.plan import Extra, PlanError, plan
from deshake.errors import OutputError
from deshake.files.part_files import create_part
from deshake.stages.estimating import kernel_name


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


def kernels(folder):
    return {"kernel": Extra(Path(folder), kernel_name)}


def outputs(jobs):
    return [job.output.as_posix() for job in jobs]


def test_one_photo_goes_beside_itself_to_a_file_or_into_a_folder():
    assert outputs(plan(paths("in/z.jpg"))) == ["in/z.deshaken.jpg"]
    assert outputs(plan(paths("a.jpg"), Path("x.jpg"))) == ["x.jpg"]
    assert outputs(plan(paths("a.jpg"), Path("in"))) == ["in/a.deshaken.jpg"]
    assert plan(paths("a.jpg"), beside=False)[0].output is None


def test_several_go_to_a_folder_that_is_made():
    jobs = plan(paths("a.jpg", "in"), Path("out"), extras=kernels("k"))
    assert outputs(jobs) == ["out/a.deshaken.jpg", "out/y.deshaken.tif", "out/z.deshaken.jpg"]
    assert [job.others["kernel"] for job in jobs] == [Path(f"k/{s}.kernel.npz") for s in "ayz"]
    assert all(job.problem is None for job in jobs)
    assert Path("out").is_dir()
    assert Path("k").is_dir()


def test_one_photo_goes_into_a_folder_that_is_made():
    jobs = plan(paths("a.jpg"), Path("out"), into=True)
    assert outputs(jobs) == ["out/a.deshaken.jpg"]
    assert jobs[0].problem is None
    assert Path("out").is_dir()
    assert outputs(plan(paths("a.jpg"), None, into=True)) == ["a.deshaken.jpg"]


def test_folders_in_folders_are_kept_in_the_results():
    jobs = plan(paths("in"), Path("out"), extras=kernels("k"), recursive=True)
    assert outputs(jobs)[-1] == "out/d/q.deshaken.jpg"
    assert jobs[-1].others["kernel"] == Path("k/d/q.kernel.npz")
    assert Path("out/d").is_dir()
    assert Path("k/d").is_dir()
    assert all(job.problem is None for job in jobs)


@pytest.mark.parametrize("out", ["in/out", "in"])
def test_results_in_the_folder_itself_are_not_read_again(out):
    first = outputs(plan(paths("in"), Path(out), recursive=True))
    for name in first:
        Path(name).write_text("a result")
    Path(out, "other.jpg").write_text("a photo, or a result under another name")
    again = outputs(plan(paths("in"), Path(out), recursive=True))
    assert again == (first if out != "in" else [f"{out}/other.deshaken.jpg", *first])


def test_a_dry_plan_makes_and_removes_nothing(tmp_path):
    handle, part = create_part("in")
    os.close(handle)
    before = sorted(tmp_path.rglob("*"))
    jobs = plan(paths("in"), Path("out"), extras=kernels("k"), recursive=True, dry=True)
    assert sorted(tmp_path.rglob("*")) == before
    assert all(job.problem is None for job in jobs)
    plan(paths("in"), Path("in"))
    assert not Path(part).exists()


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
        plan(paths("a.jpg", "a.png"), extras=kernels("k"))


def test_several_do_not_go_to_a_file_or_to_standard_output():
    with pytest.raises(PlanError, match=r"b\.PNG is a file"):
        plan(paths("a.jpg", "in"), Path("b.PNG"))
    with pytest.raises(PlanError, match="standard output"):
        plan(paths("a.jpg", "b.PNG"), Path("-"))
    with pytest.raises(PlanError, match="would both be written to x"):
        plan(paths("a.jpg", "b.PNG"), extras={"latent": Extra(Path("x"))})
    assert plan(paths("a.jpg"), Path("-"))[0].problem is None


def test_folders_that_cannot_be_made():
    with pytest.raises(OutputError, match="cannot be made: no such file"):
        plan(paths("a.jpg", "in"), Path("x/y"))
    with pytest.raises(OutputError, match="is not a folder"):
        plan(paths("a.jpg"), extras=kernels("b.PNG"))


def test_a_problem_stands_in_its_job_alone():
    Path("a.deshaken.jpg").touch()
    one, two = plan(paths("a.jpg", "b.PNG"))
    assert "exists already" in str(one.problem)
    assert two.problem is None
    assert all(job.problem is None for job in plan(paths("a.jpg", "b.PNG"), existing="replace"))


def test_existing_results_are_skipped():
    Path("a.deshaken.jpg").touch()
    Path("k").mkdir()
    Path("k/b.kernel.npz").touch()
    one, two = plan(paths("a.jpg", "b.PNG"), extras=kernels("k"), existing="skip")
    assert (one.keeps_result, two.keeps_result) == (True, False)
    assert (one.skipped, one.missing) == (False, ["kernel"])
    Path("k/a.kernel.npz").touch()
    assert (one.skipped, two.skipped) == (True, False)
    assert (two.problem, two.overwrite, two.overwrite_others) == (None, False, True)


@pytest.mark.parametrize("existing", ["skip", "replace"])
@pytest.mark.parametrize("link", [os.symlink, os.link])
def test_no_result_is_an_input_under_any_name(link, existing):
    link("b.PNG", "a.deshaken.jpg")
    one, two = plan(paths("a.jpg", "b.PNG"), existing=existing)
    assert "never touches" in str(one.problem)
    assert two.problem is None


def test_other_inputs_are_never_replaced():
    needs = {"noisy": lambda _: Path("b.PNG")}
    [job] = plan(paths("a.jpg"), Path("in/../b.PNG"), needs=needs, existing="replace")
    assert "the output is the input itself" in str(job.problem)
    assert job.files()["noisy"] == "b.PNG"


@pytest.mark.skipif(sys.platform == "win32", reason="needs symbolic links")
@pytest.mark.parametrize("dry", [False, True])
def test_an_output_tree_does_not_follow_a_link_out_of_itself(dry):
    for folder in ("tree/sub/deep", "out", "elsewhere"):
        Path(folder).mkdir(parents=True)
    for photo in ("tree/a.jpg", "tree/sub/b.jpg", "tree/sub/deep/c.jpg"):
        Path(photo).touch()
    Path("out/sub").symlink_to(Path("elsewhere").absolute())
    one, two, three = plan(paths("tree"), Path("out"), recursive=True, dry=dry)
    assert one.problem is None
    for job in (two, three):
        assert f"leads out of out, to {Path('elsewhere').resolve()}" in str(job.problem)
    assert list(Path("elsewhere").iterdir()) == []
    [asked] = plan(paths("tree/sub/b.jpg"), Path("out/sub"), dry=dry)
    assert asked.problem is None
    Path("out/sub").unlink()
    Path("out/other").mkdir()
    Path("out/sub").symlink_to("other")
    assert [job.problem for job in plan(paths("tree"), Path("out"), recursive=True, dry=dry)] == [
        None
    ] * 3


def test_a_template_places_results_and_its_folder_is_made():
    template = NameTemplate("out/{folder}/{stem}_x.{ext}")
    extras = kernels("k") | {"sheet": Extra(None, lambda path: f"{path.stem}.compare.png")}
    jobs = plan(paths("in"), template=template, recursive=True, extras=extras)
    assert outputs(jobs) == ["out/y_x.tif", "out/z_x.jpg", "out/d/q_x.jpg"]
    assert jobs[-1].others["kernel"] == Path("k/d/q.kernel.npz")
    assert jobs[-1].others["sheet"] == Path("out/d/q_x.compare.png")
    assert Path("out/d").is_dir()
    assert all(job.problem is None for job in jobs)
    with pytest.raises(OutputError, match="cannot be made: no such file"):
        plan(paths("in"), template=NameTemplate("no/such/{stem}.{ext}"))


def test_results_of_one_name_by_a_template_are_refused_and_nothing_is_made():
    Path("in/d/z.jpg").touch()
    with pytest.raises(PlanError, match=r"z\.jpg and in/d/z\.jpg would both") as refusal:
        plan(paths("in"), template=NameTemplate("out/{stem}.{ext}"), recursive=True)
    assert "more fields" in refusal.value.hint
    assert not Path("out").exists()


def test_what_is_checked_before_anything_is_made():
    def check(jobs):
        raise PlanError(f"not these {len(jobs)}")

    with pytest.raises(PlanError, match="not these 2"):
        plan(paths("in"), Path("out"), check=check)
    assert not Path("out").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="needs symbolic links")
def test_a_template_does_not_follow_a_link_out_of_its_folder():
    for folder in ("out", "elsewhere"):
        Path(folder).mkdir()
    Path("out/d").symlink_to(Path("elsewhere").absolute())
    jobs = plan(paths("in"), template=NameTemplate("out/{folder}/{stem}.{ext}"), recursive=True)
    assert [job.problem is None for job in jobs] == [True, True, False]
    assert "leads out of out" in str(jobs[-1].problem)
