# SPDX-License-Identifier: Apache-2.0
"""What MkDocs does for this site beyond its own: links out of docs/, pages made from code, links to other servers."""

import contextlib
import importlib
import io
import os
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from seed_bringup.command_table import Command, offered, usage

ROOT = Path(__file__).resolve().parents[2]
# Pages of the checkout's top folder, and what they are called on the site.
TOP = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
LINK = re.compile(r"(?<!\!)\[([^\]]*)\]\(([^)#\s]+)(#[^)\s]*)?\)")
COMMANDS_HEAD = """\
# Commands

Every command explains itself: `./seed COMMAND --help`. This page is that output.

"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made: commands, contributing, changes."""
    files.append(File.generated(config, "commands.md", content=commands_page()))
    for name in ("CONTRIBUTING.md", "CHANGELOG.md"):
        text = LINK.sub(_from_top, (ROOT / name).read_text())
        files.append(File.generated(config, TOP[name], content=text))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Links to files outside docs/ become the site's page of them, or their name alone.

    Raises:
        FileNotFoundError: there is no such file.
    """
    folder = (ROOT / "docs" / page.file.src_uri).parent

    def translated(found: re.Match[str]) -> str:
        label, target, anchor = found[1], found[2], found[3] or ""
        if not target.startswith("../"):
            return found[0]
        there = (folder / target).resolve()
        if not there.exists():
            raise FileNotFoundError(f"docs/{page.file.src_uri} links to {target}, which does not exist")
        if there.is_relative_to(ROOT / "docs"):
            return found[0]
        name = str(there.relative_to(ROOT))
        if name in TOP:
            return f"[{label}]({os.path.relpath(ROOT / 'docs' / TOP[name], folder)}{anchor})"
        return label if label.startswith("`") else f"`{label}`"

    return LINK.sub(translated, markdown)


def _from_top(found: re.Match[str]) -> str:
    """A link as it is written in the top folder, from docs/."""
    label, target, anchor = found[1], found[2], found[3] or ""
    if ":" in target:
        return found[0]
    return f"[{label}]({target[5:] if target.startswith('docs/') else '../' + target}{anchor})"


def commands_page() -> str:
    """The help of every command of ./seed."""
    table = offered(checkout=True)
    parts = [COMMANDS_HEAD, "## seed\n\n```text\n" + usage(table) + "\n```\n"]
    parts += [f"\n## seed {c.name}\n\n```text\n{help_of(c)}\n```\n" for c in table.values()]
    return "".join(parts)


def help_of(command: Command) -> str:
    """What `./seed COMMAND --help` prints; nothing but the help is run."""
    text = io.StringIO()
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = "110"
    try:
        run = getattr(importlib.import_module(command.module), command.function)
        with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
            run(["--help"])
    finally:
        os.environ.pop("COLUMNS") if before is None else os.environ.update(COLUMNS=before)
    return text.getvalue().strip().replace("```", "'''")
