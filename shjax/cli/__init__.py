"""The command line: a thin layer that reads, calls the library, and writes.

Exit status: 0, or one line on standard error and 2 (bad input) or 1 (a failure).
A command's module is imported when it is asked for, and JAX when it runs.
"""

from __future__ import annotations

import importlib
import io
import os
import sys
import threading

import click

import shjax
from shjax.cli.compiled import CACHE_VARIABLE, keep_compiled

AHEAD_THREAD = "shjax-ahead"  # compiles what a command will run


class Commands(click.Group):
    """Commands by name: their module, the function there, and what they do."""

    known = {  # noqa: RUF012
        "light": ("light", "Lighting coefficients, irradiance and spheres."),
        "reflect": ("reflect", "The reflection model for an error, and spheres."),
        "render": ("render_command", "A picture of a mesh under a panorama."),
        "estimate": ("estimate", "The light from a picture of a known object."),
        "score": ("score", "How far a predicted light is from the true one."),
        "convert": ("convert", "Coefficients in another tool's format."),
        "remap": ("remap", "An environment map in another layout."),
    }

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of their use."""
        return list(self.known)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        if cmd_name not in self.known:
            return None
        module = importlib.import_module(f"shjax.cli.{cmd_name}")
        return getattr(module, self.known[cmd_name][0])

    def format_commands(
        self, ctx: click.Context, formatter: click.HelpFormatter
    ) -> None:
        """List the commands without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in self.known.items()])


@click.group(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 88},
    epilog="Run 'shjax COMMAND --help' for the options of a command.",
)
@click.version_option(shjax.__version__, prog_name="shjax")
@click.option(
    "--no-cache",
    is_flag=True,
    help="Do not keep what is compiled for the next run, nor use what is kept "
    f"(variable {CACHE_VARIABLE}: off, or a folder).",
)
def cli(no_cache: bool) -> None:
    """Lighting in frequency space: panoramas, spherical harmonics, irradiance."""
    if no_cache:
        os.environ[CACHE_VARIABLE] = "off"
        os.environ["JAX_ENABLE_COMPILATION_CACHE"] = "false"
    keep_compiled()


def main() -> None:
    """Run the command line; errors are one line on standard error."""
    for stream in (sys.stdout, sys.stderr):  # a file's name may be of no encoding
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
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
    if any(thread.name == AHEAD_THREAD for thread in threading.enumerate()):
        # A compiler at work would crash in an interpreter that ends.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status or 0)
    sys.exit(status or 0)


def _say(text: str) -> None:
    print("shjax: " + " ".join(text.split()), file=sys.stderr)
