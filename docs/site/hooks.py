"""What is made while the site is built: pages from the program, and equations as MathML."""

import html
import re
import sys
from pathlib import Path
from typing import Any

import typer
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from mkdocs.utils import get_relative_url

sys.path.insert(0, str(Path(__file__).parent))

from roles import ROLE, name_of
from yaml_reference import yaml_reference

from wbc.cli import app
from wbc.problem import json_schema

# Arithmatex leaves \( \) and \[ \] to a script; MathML needs none, and works offline.
EQUATION = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


# The offline plugin's pages take from a server what searches in a page that was opened as a file.
SHIM, SHIM_SOURCE = "assets/iframe-worker.js", "https://unpkg.com/iframe-worker/shim"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that the program writes itself, and the script for searching in files."""
    script = Path(__file__).with_name("iframe-worker.js").read_text()
    files.append(File.generated(config, SHIM, content=script))
    files.append(
        File.generated(
            config, "reference/yaml.md", content=ROLE.sub(name_of, yaml_reference(json_schema()))
        )
    )
    files.append(File.generated(config, "reference/cli.md", content=command_reference()))
    return files


def on_post_page(output: str, page: Page, **kwargs: Any) -> str:
    """Load that script from the site itself."""
    here = get_relative_url(SHIM, page.url)
    return output.replace(f'src="{SHIM_SOURCE}"', f'src="{here}"')


def on_post_template(output_content: str, **kwargs: Any) -> str:
    """Likewise for the page of addresses that lead nowhere, which only servers show."""
    return output_content.replace(f'src="{SHIM_SOURCE}"', f'src="/{SHIM}"')


def on_page_content(html: str, **kwargs: Any) -> str:
    """Turn equations into MathML."""
    return EQUATION.sub(_math, html)


def _math(found: re.Match[str]) -> str:
    kind, _, text = found.groups()
    made = convert(html.unescape(text), display="block" if kind == "div" else "inline")
    if "<mi>&</mi>" in made or "\\" in made:  # what the converter does not know it passes on
        raise PluginError(f"equation not understood: {text}")
    if any(ord(one) > 0xFFFF for one in made):  # script letters and the like: boxes in most fonts
        raise PluginError(f"equation with letters that only mathematical fonts have: {text}")
    return made


def _commands(group: Any, before: str = "") -> list[tuple[str, Any]]:
    """Return all commands by their names, those of groups as ``group command``."""
    found = list[tuple[str, Any]]()
    for name, command in group.commands.items():
        inner = hasattr(command, "commands")
        found += _commands(command, f"{name} ") if inner else [(before + name, command)]
    return found


def command_reference() -> str:
    """Return the reference of the command line as Markdown."""
    group = typer.main.get_command(app)
    parts = ["# Command line\n\nMade from the program. `wbc COMMAND --help` says the same.\n"]
    for name, command in _commands(group):
        arguments = [p for p in command.params if p.param_type_name == "argument"]
        options = [p for p in command.params if p.param_type_name == "option"]
        usage = " ".join(["wbc", name, *(p.metavar or p.name.upper() for p in arguments)])
        parts.append(f"## `{usage}`\n\n{command.help or ''}\n")
        if options:
            parts.append("| option | meaning | default |\n|---|---|---|")
        for option in options:
            words = ", ".join(f"`{one}`" for one in option.opts)
            default = option.default
            shown = "" if default in (None, False, [], ()) or callable(default) else f"`{default}`"
            parts.append(
                f"| {words} | {(option.help or '').replace('|', chr(92) + '|')} | {shown} |"
            )
        if getattr(command, "epilog", None):
            parts.append(f"\n{command.epilog}\n")
        parts.append("")
    return "\n".join(parts)
