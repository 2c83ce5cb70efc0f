from __future__ import annotations

import subprocess
import sys

import click
import pytest
from click.testing import CliRunner

from deshake.cli import options
from deshake.cli.general_options import general_options


@pytest.fixture
def parse():
    """Parse arguments by some options, and return the parameters or what is wrong."""

    def run(decorator, *args):
        @click.command()
        @decorator
        def command(**params):
            parsed.update(params)

        parsed = {}
        result = CliRunner().invoke(command, args)
        return parsed if result.exit_code == 0 else result.output

    return run


def test_focal_length_comes_from_one_place(parse):
    def both(command):
        return options.focal_options(options.camera_option(command))

    parsed = parse(both, "--focal-35mm", "28")
    assert parsed["focal_35mm"] == 28
    assert (parsed["focal_px"], parsed["camera"]) == (None, None)
    assert parse(both, "--camera", "c.npz")["camera"].name == "c.npz"
    for args in (
        ("--focal-px", "3000", "--focal-35mm", "28"),
        ("--focal-px", "3000", "--camera", "c.npz"),
        ("--camera", "c.npz", "--focal-35mm", "28"),
    ):
        assert "cannot both be given" in parse(both, *args)


def test_focal_lengths_are_positive(parse):
    assert "not a number above 0" in parse(options.focal_options, "--focal-px", "0")


def test_the_blur_is_bounded_one_way(parse):
    assert parse(options.blur_options, "--max-angle", "1.5")["max_angle"] == 1.5
    assert parse(options.blur_options, "--blur-size", "40")["blur_size"] == 40
    text = parse(options.blur_options, "--max-angle", "1", "--blur-size", "40")
    assert "--max-angle and --blur-size cannot both be given" in text or (
        "--blur-size and --max-angle cannot both be given" in text
    )


def test_flags_and_choices(parse):
    assert parse(options.uniform_option) == {"uniform": False}
    assert parse(options.json_option, "--json") == {"as_json": True}
    assert parse(options.overwrite_option, "--overwrite") == {"overwrite": True}
    assert parse(options.transfer_option, "--transfer", "gamma22") == {"transfer": "gamma22"}
    assert "'log' is not one of" in parse(options.transfer_option, "--transfer", "log")


def test_arguments_are_paths(parse):
    assert parse(options.photo_argument, "a.jpg")["photo"].name == "a.jpg"
    assert str(parse(options.kernel_argument, "-")["kernel"]) == "-"


@pytest.mark.parametrize(
    ("decorator", "shown"),
    [
        (options.output_option("beside the photo", metavar="DIR"), "--output DIR"),
        (options.output_option("beside the photo"), "[default: beside the photo]"),
        (options.region_option, "--region X,Y,W,H"),
        (options.blur_options, "--max-angle DEGREES"),
        (options.blur_options, "--blur-size PIXELS"),
        (options.focal_options, "--focal-35mm MILLIMETRES"),
        (options.camera_option, "--camera FILE.npz"),
        (options.transfer_option, "[linear|srgb|gamma22]"),
        (general_options, "--threads N"),
    ],
)
def test_help_shows_units_and_defaults(decorator, shown):
    command = click.command()(decorator(lambda: None))
    text = CliRunner().invoke(command, ["--help"], terminal_width=200).output
    assert shown in text


def test_threads_bind_the_libraries():
    code = (
        "from deshake.cli.main import main\n"
        "assert main(['--threads', '1', 'render-kernel', 'none.npz']) == 1\n"
        "import cv2, os\n"
        "print(cv2.getNumThreads(), os.environ['OPENBLAS_NUM_THREADS'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["1", "1"]
