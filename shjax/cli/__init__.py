"""The command line: a thin layer that reads, calls the library, and writes.

Exit status: 0, or one line on standard error and 2 (bad input) or 1 (a failure).
"""

from __future__ import annotations

import io
import os
import sys

import click

import shjax


@click.group(
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 88},
    epilog="Run 'shjax COMMAND --help' for the options of a command.",
)
@click.version_option(shjax.__version__, prog_name="shjax")
def cli() -> None:
    """Lighting in frequency space: panoramas, spherical harmonics, irradiance."""


def main() -> None:
    """Run the command line; errors are one line on standard error."""
    for stream in (sys.stdout, sys.stderr):  # a file's name may be of no encoding
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    from shjax.cli.convert import convert
    from shjax.cli.estimate import estimate
    from shjax.cli.light import light
    from shjax.cli.reflect import reflect
    from shjax.cli.remap import remap
    from shjax.cli.render import render_command
    from shjax.cli.score import score

    cli.add_command(light)
    cli.add_command(reflect)
    cli.add_command(render_command, "render")
    cli.add_command(estimate)
    cli.add_command(score)
    cli.add_command(convert)
    cli.add_command(remap)
    try:
        status = cli.main(standalone_mode=False)
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read the output has enough of it; files were written before.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 1
    except click.exceptions.NoArgsIsHelpError as error:
        print(error.format_message())
        status = 2
    except click.ClickException as error:
        _say(error.format_message())
        status = error.exit_code if isinstance(error, click.UsageError) else 2
    except click.Abort:
        _say("interrupted")
        status = 1
    except (ValueError, OSError, ImportError) as error:
        _say(str(error))
        status = 2
    except MemoryError:
        _say("not enough memory")
        status = 1
    sys.exit(status or 0)


def _say(text: str) -> None:
    print("shjax: " + " ".join(text.split()), file=sys.stderr)
