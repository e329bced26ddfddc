"""The pages in docs/ and the README: links lead somewhere, commands and files exist, made pages are up to date."""

from __future__ import annotations

import ast
import importlib
import re
import runpy
import shlex
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main
import yaml

from bsp_informed_planner.cli.app import app
from bsp_informed_planner.nodes.error_codes import BY_CLASS, BY_STATE

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
pages = pytest.mark.parametrize("page", PAGES, ids=NAMES)

FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"(?:(?<=\n\n)|\A)((?: {4}.*\n)+)")
INLINE = re.compile(r"`([^`\n]+)`")
LINK = re.compile(r"\]\(([^()\s]+)\)")


def prose(text: str) -> str:
    """A page without its code."""
    return INLINE.sub("", FENCE.sub("", text))


def code(text: str) -> Iterator[str]:
    """Blocks and pieces of code of a page, blocks with continued lines joined."""
    without_fences = FENCE.sub("\n", text)
    blocks = [block for _, block in FENCE.findall(text)] + INDENTED.findall(without_fences)
    for block in blocks:
        yield from re.sub(r"\\\n\s*", "", block).splitlines()
    yield from INLINE.findall(without_fences)


def anchors(page: Path) -> set[str]:
    """Of the headings of a page, as the generator makes them from plain ASCII text."""
    found: set[str] = set()
    for heading in re.findall(r"^#+ (.+)$", FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE):
        plain = unicodedata.normalize("NFKD", re.sub(r"[`*]", "", heading)).encode("ascii", "ignore").decode()
        found.add(re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower()))
    return found


@pages
def test_links_lead_somewhere(page: Path) -> None:
    for link in LINK.findall(prose(page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), link
        if page.is_relative_to(DOCS):
            assert target.is_relative_to(DOCS), f"{link} leads out of docs/: it would be dead in the site"
        if anchor:
            assert anchor in anchors(target), link


def commands(text: str) -> Iterator[list[str]]:
    """The arguments of every `bsp-planner ...` in the code of a page."""
    for line in code(text):
        for call in re.findall(r"(?:^|[\s/(])bsp-planner((?:\s[^|;&>]*)?)(?=$|[|;&>])", line):
            yield shlex.split(call.replace("...", ""), comments=True)


def check_command(words: list[str]) -> None:
    """Raises if a subcommand or an option does not exist, lacks its value, or arguments are too many."""
    command: Any = typer.main.get_command(app)
    words = list(words)
    while getattr(command, "commands", None) and words:
        if words[0].startswith("-"):
            break
        command = command.commands[words.pop(0)]
    with command.context_class(command, info_name=command.name) as context:
        _, left, _ = command.make_parser(context).parse_args(words)
    room = sum(parameter.param_type_name == "argument" for parameter in command.params)
    assert len(left) <= room, f"too many arguments: {left}"


@pages
def test_commands_exist(page: Path) -> None:
    for words in commands(page.read_text(encoding="utf-8")):
        check_command(words)


@pytest.mark.parametrize("wrong", ["plann x.yaml", "plan --goals 1", "robot look x.urdf", "demo ur5", "plan --seed"])
def test_wrong_commands_are_found(wrong: str) -> None:
    [words] = commands(f"`bsp-planner {wrong}`\n")
    with pytest.raises(Exception, match=r".+"):
        check_command(words)


def test_commands_are_found_wherever_they_stand() -> None:
    text = "```sh\n.venv/bin/bsp-planner demo \\\n  --seed 1   # why\nbsp-planner nodes | tee x\n```\n\n"
    text += "    bsp-planner view\n\n"
    assert list(commands(text)) == [["demo", "--seed", "1"], ["nodes"], ["view"]]


@pages
def test_files_that_are_named_exist(page: Path) -> None:
    """`folder/file.py` in the prose: from the root, from the package or from docs/."""
    for name in INLINE.findall(FENCE.sub("", page.read_text(encoding="utf-8"))):
        if re.fullmatch(r"[\w.-]+/[\w./-]+\.(py|ya?ml|md|msg|srv|action|urdf|srdf|xml)", name):
            places = (ROOT, ROOT / "bsp_informed_planner", DOCS)
            assert any((place / name).is_file() for place in places), name


@pages
def test_targets_of_make_exist(page: Path) -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    named = {
        found for piece in code(page.read_text(encoding="utf-8")) for found in re.findall(r"^make ([a-z]+)", piece)
    }
    assert named <= targets


@pages
def test_python_can_be_imported(page: Path) -> None:
    for language, block in FENCE.findall(page.read_text(encoding="utf-8")):
        if language != "python":
            continue
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("bsp_informed_planner."):
                module = importlib.import_module(str(node.module))
                for alias in node.names:
                    assert hasattr(module, alias.name), f"{node.module} has no {alias.name}"


@pages
def test_examples_are_quoted_word_for_word(page: Path) -> None:
    """A block of Python whose first line is `# examples/FILE` is a part of that file."""
    for _, block in FENCE.findall(page.read_text(encoding="utf-8")):
        first, _, rest = block.partition("\n")
        if found := re.fullmatch(r"# (examples/\w+\.py)", first):
            assert rest.strip() in (ROOT / found.group(1)).read_text(encoding="utf-8"), first


def test_every_page_is_in_the_navigation() -> None:
    def listed(entry: object) -> Iterator[str]:
        if isinstance(entry, str):
            yield entry
        else:
            for inner in entry if isinstance(entry, list) else dict(entry).values():  # type: ignore[call-overload]
                yield from listed(inner)

    config = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    named = list(listed(config["nav"]))
    assert len(named) == len(set(named))
    assert set(named) == {str(page.relative_to(DOCS)) for page in PAGES if page.is_relative_to(DOCS)}


def tool(name: str) -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "tools" / f"{name}.py"))


@pytest.mark.parametrize("name", ["message_reference", "error_reference"])
def test_made_pages_are_up_to_date(name: str) -> None:
    module = tool(name)
    assert module["PAGE"].read_text(encoding="utf-8") == module["page"](), f"run: python tools/{name}.py"


def test_messages_are_read_as_they_are_written() -> None:
    about, [request, response] = tool("message_reference")["parse"](
        "# What it\n# is.\nint32 first\n\n# Two.\nfloat64[3] a\nfloat64 b -1.0\n---\nbyte X=1 # one\nFoo[] foos\n"
    )
    assert about == "What it is."
    assert [(group.comment, group.rows) for group in request] == [
        ("", [("int32", "`first`")]),
        ("Two.", [("float64[3]", "`a`"), ("float64", "`b`, default -1.0")]),
    ]
    assert [(group.comment, group.rows) for group in response] == [
        ("one", [("byte", "`X` = 1")]),
        ("", [("Foo[]", "`foos`")]),
    ]


def test_there_is_advice_for_every_error_with_a_code() -> None:
    assert set(tool("error_reference")["ADVICE"]) == {*BY_STATE, *(kind for kind, _ in BY_CLASS)}
