# SPDX-License-Identifier: Apache-2.0
"""The documents: the site builds strictly and asks nothing of other servers; tutorials show what happens."""

import contextlib
import dataclasses
import io
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from seed_bringup.commands import developer, dispatch
from seed_control.tasks.insertion.sections import Insert, Search
from seed_control.tasks.task import ContactStop, Control, Drawing, Phase, Task, WorkFrame

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(not (ROOT / "seed").is_file(), reason="this is an installed copy, not the checkout")
TUTORIALS = sorted(f for f in (ROOT / "docs/tutorials").glob("*.md") if f.stem != "index")
FENCE = re.compile(r"^```(\w+)(?: title=\"([\w.]+)\")?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"-?\d+\.?\d*")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    pytest.importorskip("material", reason="mkdocs-material is not installed")
    monkeypatch.setenv("SEED_ROOT", str(ROOT))
    out = tmp_path / "site"
    assert developer.docs(["--out", str(out)]) == 0
    return out


@pytest.mark.slow
def test_the_site_builds_strictly_and_asks_nothing_of_other_servers(site: Path) -> None:
    """Strict: a broken link or anchor, or a page that is in no menu, fails the build."""
    pages = {str(f.relative_to(site)): f.read_text() for f in site.glob("**/*.html")}
    sources = {str(f.relative_to(ROOT / "docs").with_suffix(".html")) for f in (ROOT / "docs").glob("**/*.md")}
    assert sources | {"commands.html", "changelog.html", "contributing.html"} <= set(pages)
    for name, text in pages.items():
        loaded = re.findall(r"<(?:script|img|iframe)[^>]* src=\"?([^\s\">]+)", text)
        loaded += re.findall(r"<link(?![^>]*rel=\"?canonical)[^>]* href=\"?([^\s\">]+)", text)
        assert not [link for link in loaded if link.startswith(("http:", "https:", "//"))], name
        assert 'class="mermaid"' not in text, f"{name}: its drawing is fetched from another server"
    assert "seed_core.Bushing" in pages["api/seed_core.html"]
    assert "--estimator" in pages["commands.html"]
    assert (site / "search/search_index.json").stat().st_size > 100_000


def test_a_broken_link_fails_the_build(tmp_path: Path) -> None:
    pytest.importorskip("material", reason="mkdocs-material is not installed")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs/index.md").write_text("# A\n[there](#nowhere)\n")
    settings = (ROOT / "mkdocs.yml").read_text()
    checks = settings[settings.index("validation:") : settings.index("nav:\n")]
    (tmp_path / "mkdocs.yml").write_text(f"site_name: a\n{checks}")
    command = [sys.executable, "-P", "-m", "mkdocs", "build", "--strict"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1
    assert "#nowhere" in done.stderr


def run(line: str) -> str:
    """What a command line of a tutorial prints; ./seed and python run in this process, without a start of their own."""
    asked, _, code = line.partition("; echo ")
    words = asked.split()
    if words[0] not in ("./seed", "python"):
        done = subprocess.run(["sh", "-c", line], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
        if words[0] == "./seed":
            exit_code = dispatch.main(words[1:])
        else:
            runpy.run_path(words[1], run_name="__main__")
            exit_code = 0
    if not code:
        assert exit_code == 0, text.getvalue()
        return text.getvalue()
    return f"{text.getvalue()}exit code {exit_code}\n"


def alike(shown: str, said: str) -> bool:
    """Whether a line is as shown: '...' stands for anything, numbers may differ by 1 % or two of their last digit."""
    parts = [re.escape(part) for part in NUMBER.sub("#", shown).split("...")]
    pattern = ".*".join(re.sub(r"\\ (\\ )*", r"\\s+", part) for part in parts).replace(r"\#", f"({NUMBER.pattern})")
    found = re.fullmatch(pattern, said)
    if not found:
        return False
    return all(map(near, found.groups(), NUMBER.findall(shown)))


def near(said: str, shown: str) -> bool:
    """Whether a printed number is the one that is shown: a stale page fails, another machine does not."""
    last = 10.0 ** -len(shown.partition(".")[2])
    return abs(float(said) - float(shown)) <= max(2.0 * last, 0.01 * abs(float(shown))) + 1e-9


def check_output(shown: list[str], said: list[str], where: str) -> None:
    """Every line that is shown comes, in this order; a line of dots stands for any lines."""
    at = 0
    for line in filter(None, (x for x in shown if x.strip() != "...")):
        while at < len(said) and not alike(line.rstrip(), said[at].rstrip()):
            at += 1
        assert at < len(said), f"{where} shows\n{line}\nand this came:\n" + "\n".join(said)
        at += 1


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda f: f.stem)
def test_a_tutorial_shows_what_happens(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that have a title are written, `console` blocks are run in order; `sh` blocks want a live cell."""
    pytest.importorskip("pydrake", reason="the simulator is not installed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    ran = 0
    for kind, title, text in FENCE.findall(page.read_text()):
        if title:
            (tmp_path / title).write_text(text)
        elif kind == "console":
            for command, shown in re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", text, re.MULTILINE):
                check_output(shown.splitlines(), run(command).splitlines(), f"{page.name}: $ {command}")
                ran += 1
    sys.modules.pop("my_estimate", None)
    assert ran >= 1


PYTHON = [f for f in (ROOT / "docs").glob("*.md") if re.search(r"^```python\n", f.read_text(), re.MULTILINE)]


@pytest.mark.parametrize("page", [p for p in PYTHON if p.stem != "learning"], ids=lambda f: f.stem)
def test_the_python_of_a_page_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each block by itself; that of the page on learning runs in test_examples.py, in a process of its own."""
    pytest.importorskip("pydrake", reason="the simulator is not installed")
    monkeypatch.chdir(tmp_path)
    for code in re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL):
        exec(compile(code, str(page), "exec"), {"__name__": "__main__"})


def test_every_task_of_the_page_on_tasks_loads(tmp_path: Path) -> None:
    from seed_control.tasks import load_task

    page = (ROOT / "docs/tasks.md").read_text()
    written = re.findall(r"^```yaml\n(name: (\w+)\n.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert len(written) >= 6
    for text, name in written:
        (tmp_path / f"{name}.yaml").write_text(text)
        assert load_task(str(tmp_path / f"{name}.yaml")).phases, name


def test_every_key_of_a_task_file_is_on_the_page_on_tasks() -> None:
    lines = (ROOT / "docs/tasks.md").read_text(encoding="utf-8").splitlines()
    named = re.findall(r"`([\w.]+)`", " ".join(line.split("|")[1] for line in lines if line.startswith("|")))
    for section in (Task, WorkFrame, Phase, Control, ContactStop, Search, Insert, Drawing):
        missing = {f.name for f in dataclasses.fields(section)} - {name.split(".")[-1] for name in named}
        assert not missing, f"{section.__name__}: {missing}"


def test_numbers_that_differ_are_told_from_those_that_do_not() -> None:
    assert alike("force  -2.002 N", "force    -2.001 N")
    assert not alike("force -2.0 N", "force -3.0 N")
    assert not alike("at z = 0.276 m", "at z = 0.270 m")
    assert not alike("mean -8.392 N", "mean -8.510 N")
    assert alike("rmse 0.003 N", "rmse 0.002 N")
    assert not alike("worst 0.011 N", "worst 0.005 N")
    assert not alike("worst 0.053 N", "worst 0.044 N")
    assert alike("a ... end", "a long way to the end")
    assert not alike("a ... end", "another end is here")


def test_lists_and_tables_stand_apart_from_the_text_before_them() -> None:
    """Without an empty line the site shows them as running text."""
    begins = re.compile(r"- |\d+\. |\|")
    for page in [ROOT / "README.md", *sorted(ROOT.glob("C*.md")), *sorted((ROOT / "docs").glob("**/*.md"))]:
        prose = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
        for block in re.split(r"\n\s*\n", prose):
            first, *others = [line for line in block.strip("\n").splitlines() if not line.startswith("#")] or [""]
            if not begins.match(first):
                late = [line for line in others if begins.match(line)]
                assert not late, f"{page.name}: an empty line is missing before {late[0][:60]!r}"


# What the documents do not write, and what they write instead.
WORDS = {
    r"\bset ?points?\b": "set-point",
    r"\bcolor\b": "colour",
    r"\bgray\b": "grey",
    r"\bbehavior\b": "behaviour",
    r"\bcenter\b": "centre",
    r"\binitialise": "initialize",
    r"\bstandin\b": "stand-in",
    r"\bmicroslip\b|\bmicro slip\b": "micro-slip",
    r"\b(?:milli)?meters\b": "metres",
    r"\btime ?stamps?\b": "stamp",
    r"\bslippage\b": "slip",
    r"\bend-effector": "end effector",
    r"\bcalibration that is none\b": "what is wrong with it",
}


def test_terms_are_spelt_alike() -> None:
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("**/*.md"))]:
        prose = re.sub(
            r"```.*?```|`[^`]*`|\]\([^)]*\)|^    [^\n]*$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE
        )
        for pattern, right in WORDS.items():
            wrong = re.search(pattern, prose)
            assert not wrong, f"{page.name}: {wrong[0]!r} should be {right}"
