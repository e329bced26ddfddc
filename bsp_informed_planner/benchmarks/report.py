"""The report of a benchmark: numbers that were required, tables, pictures."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from bsp_informed_planner.benchmarks.statistics import Estimate, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COMPARISONS = {"at most": operator.le, "at least": operator.ge, "exactly": operator.eq}


@dataclass(frozen=True)
class RequiredNumber:
    """A number that was to be reached.

    Attributes:
        name: what was measured.
        measured: its value; an interval is reported, but the value decides.
        comparison: "at most", "at least" or "exactly"; "reported" if it only had to be measured.
        limit: what is required; no matter if it is reported.
        unit: of both, e.g. "ms" or "%"; may be empty.
        remark: added to the measured value, e.g. of how many cases it is.
        digits: significant ones of the measured value.
        apart: whether the intervals of what is compared are apart, where it is two measurements.
        quick: whether it was measured in a few cases only.
    """

    name: str
    measured: Estimate | float
    comparison: str
    limit: float = math.nan
    unit: str = ""
    remark: str = ""
    digits: int = 3
    apart: bool = True
    quick: bool = False

    @property
    def value(self) -> float:
        return self.measured.value if isinstance(self.measured, Estimate) else self.measured

    @property
    def holds(self) -> bool:
        """False for a value that is not a number."""
        if self.comparison == "reported":
            return math.isfinite(self.value)
        return bool(_COMPARISONS[self.comparison](self.value, self.limit))

    @property
    def measured_text(self) -> str:
        if self.comparison == "exactly" and self.value == round(self.value):
            return " ".join(filter(None, (f"{self.value:,.0f}", self.unit, self.remark)))
        text = (
            self.measured.text(self.digits)
            if isinstance(self.measured, Estimate)
            else number(self.measured, self.digits)
        )
        return " ".join(filter(None, (text, self.unit, self.remark)))

    @property
    def required_text(self) -> str:
        if self.comparison == "reported":
            return "to be reported"
        comparison = "" if self.comparison == "exactly" else self.comparison
        return " ".join(filter(None, (comparison, f"{self.limit:g}", self.unit)))

    @property
    def verdict(self) -> str:
        """What to make of it: nothing where it only had to be measured, and is.

        Two measurements whose intervals overlap are not told apart. Nor are, in a quick run, the number and what is
        required, where the interval holds that: a full run is there to tell, and there the value decides.
        """
        if self.comparison == "reported":
            return "" if self.holds else "not measured"
        wide = isinstance(self.measured, Estimate) and self.measured.low < self.limit < self.measured.high
        if not self.apart or (self.quick and wide):
            return "not told apart"
        return "holds" if self.holds else "falls short"

    def line(self) -> str:
        """`name: measured (required) holds`, or what else the verdict is."""
        return f"{self.name}: {self.measured_text} ({self.required_text}) {self.verdict}".rstrip()


@dataclass
class Section:
    """A part of the report, filled from top to bottom.

    Attributes:
        title: heading.
        blocks: paragraphs, tables and references to pictures, in Markdown.
        figures: pictures by file name.
        numbers: required numbers.
        findings: sentences that a reader must not miss; they begin the report.
    """

    title: str
    blocks: list[str] = field(default_factory=list)
    figures: dict[str, Figure] = field(default_factory=dict)
    numbers: list[RequiredNumber] = field(default_factory=list)
    findings: list[str] = field(default_factory=list)

    def text(self, paragraph: str) -> None:
        self.blocks.append(paragraph)

    def table(self, header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        """A table; the first column is aligned to the left, the others to the right."""
        self.blocks.append(markdown_table(header, rows))

    def picture(self, name: str, figure: Figure, caption: str) -> None:
        """A picture, to be written as `name`.png."""
        self.figures[f"{name}.png"] = figure
        self.blocks.append(f"![{caption}]({name}.png)")

    def require(self, required: RequiredNumber) -> None:
        self.numbers.append(required)

    def find(self, sentence: str) -> None:
        """A sentence for the top of the report."""
        self.findings.append(sentence)


@dataclass
class Report:
    """All of a report.

    Attributes:
        title, introduction: for people.
        command: that makes it.
        machine: what it was measured on.
        load: what else it did meanwhile.
        sections: one for each part.
        state: a sentence if cases are missing; else empty.
    """

    title: str
    introduction: str
    command: str
    machine: dict[str, str]
    load: str = ""
    sections: list[Section] = field(default_factory=list)
    state: str = ""

    @property
    def numbers(self) -> list[RequiredNumber]:
        return [number for section in self.sections for number in section.numbers]

    def markdown(self) -> str:
        """The text of report.md."""
        numbers = markdown_table(
            ["number", "measured", "required", ""],
            [[n.name, n.measured_text, n.required_text, n.verdict] for n in self.numbers],
        )
        facts = self.machine | ({"load": self.load} if self.load else {})
        machine = markdown_table(["", ""], list(facts.items()))
        parts = [f"# {self.title}", self.introduction]
        if self.state:
            parts.append(f"**{self.state}**")
        findings = [sentence for section in self.sections for sentence in section.findings]
        if findings:
            parts += ["## Findings", "\n".join(f"- {sentence}" for sentence in findings)]
        parts += [
            "Made by",
            f"```sh\n{self.command}\n```",
            "## Numbers",
            "Brackets hold 95 % confidence intervals: by bootstrap over cases, of shares by Wilson's formula.",
            numbers,
        ]
        for section in self.sections:
            parts += [f"## {section.title}", *(section.blocks or ["No results."])]
        return "\n\n".join([*parts, "## Machine", machine]) + "\n"

    def write(self, folder: Path) -> None:
        """Writes report.md and the pictures.

        Raises:
            OSError: if that fails.
        """
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "report.md").write_text(self.markdown(), encoding="utf-8")
        for section in self.sections:
            for name, figure in section.figures.items():
                figure.savefig(folder / name, dpi=figure.dpi)


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table in Markdown; floats get three significant digits."""

    def cell(value: object) -> str:
        if isinstance(value, float):
            return number(value)
        if isinstance(value, Estimate):
            return value.text()
        if isinstance(value, int) and not isinstance(value, bool):
            return f"{value:,}"
        return str(value).replace("|", "\\|")

    lines = [list(header), ["---", *("---:" for _ in header[1:])], *([cell(value) for value in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
