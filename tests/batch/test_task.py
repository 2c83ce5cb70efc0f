from __future__ import annotations

import logging

from deshake.batch.plan import Job
from deshake.batch.task import run_job
from deshake.errors import OutputError
from deshake.run import Run


def progress(share, text):
    assert (share, text) == (0.5, "half")


def test_what_came_of_a_photo(trial, jobs):
    [job] = jobs("warn")
    result = run_job(job, trial(), run=Run(3, progress))
    assert (result.status, result.warnings, result.error) == ("done", ("mind",), None)
    assert result.figures["threads"] == 3
    assert result.seconds >= 0
    report = result.report()
    assert report["input"] == str(job.source)
    assert report["output"] == str(job.output)
    assert report["warnings"] == ["mind"]
    assert "error" not in report
    assert job.output.read_text() == "done"


def test_an_error_is_reported_without_a_trace(trial, jobs):
    [job] = jobs("fail")
    result = run_job(job, trial())
    assert result.status == "failed"
    assert (result.error, result.hint) == (f"{job.source}: is bad", "drop it")
    assert result.trace is None
    assert result.report()["hint"] == "drop it"


def test_a_bug_is_reported_with_its_trace(trial, jobs):
    [job] = jobs("bug")
    result = run_job(job, trial())
    assert result.error == f"{job.source}: ZeroDivisionError: by zero"
    assert "bug" in result.hint
    assert "Traceback" in result.trace


def test_a_problem_of_the_plan_is_the_result(trial, tmp_path):
    job = Job(tmp_path / "a.jpg", tmp_path / "b.jpg", problem=OutputError("exists already"))
    result = run_job(job, trial())
    assert (result.status, result.error) == ("failed", f"{tmp_path / 'a.jpg'}: exists already")


def test_existing_results_are_skipped(trial, jobs):
    [job] = jobs("fail", existing="skip")
    job.output.write_text("mine")
    assert run_job(job, trial()).status == "skipped"
    assert job.output.read_text() == "mine"


def test_what_another_run_made_meanwhile_is_skipped(jobs):
    [job] = jobs("", existing="skip")

    def work(*_, **__):
        job.output.write_text("the other's")
        raise OutputError("exists already", file=job.output)

    assert run_job(job, work).status == "skipped"
    [job] = jobs("", existing="refuse")
    assert run_job(job, work).status == "failed"


def test_warnings_of_other_threads_are_not_this_photos(jobs):
    [job] = jobs("")

    def work(*_, **__):
        record = logging.makeLogRecord({"levelno": logging.WARNING, "msg": "another's"})
        record.thread = -1
        logging.getLogger("deshake").handle(record)
        return {}

    assert run_job(job, work).warnings == ()


def test_notes_are_among_the_warnings_once(jobs, caplog):
    [job] = jobs("")

    def work(*_, **__):
        logging.getLogger("deshake").warning("%s: one", job.source)
        return {"notes": ["one", "two"], "x": 1}

    for level in (logging.ERROR, logging.WARNING):
        caplog.set_level(level, "deshake")
        result = run_job(job, work)
        assert (result.warnings, result.figures) == (("one", "two"), {"x": 1})
