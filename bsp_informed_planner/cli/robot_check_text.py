"""The report of `bsp-planner robot check` in words: each part is printed when it is known."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Console
from rich.table import Table

from bsp_informed_planner.collision.bounds_report import BoundsReport
from bsp_informed_planner.collision.check_speed import CheckSpeed
from bsp_informed_planner.robots.report import RobotReport, Severity
from bsp_informed_planner.robots.self_collision import PairKind

_COLOURS = {Severity.ERROR: "red", Severity.WARNING: "yellow", Severity.NOTE: "cyan"}


class ReportText:
    """Prints the parts of a report, on standard output.

    Args:
        silent: print nothing, for reports that are printed otherwise.
    """

    def __init__(self, silent: bool = False) -> None:
        console = Console(highlight=False, soft_wrap=True, quiet=silent)
        if not console.is_terminal:
            console = Console(highlight=False, soft_wrap=True, width=160, quiet=silent)
        self._console = console

    def robot(self, report: RobotReport) -> None:
        """Frames, joints, bodies, and what was found out by trying."""
        console = self._console
        if report.name:
            frames = f": root frame {report.root_frame}, tool frame {report.tool_frame}" if report.root_frame else ""
            console.print(f"[bold]{report.name}[/bold]{frames}", markup=True)
        if report.joints:
            console.print(_joint_table(report))
            if report.held:
                console.print("held: " + ", ".join(f"{name} = {value:.4g}" for name, value in report.held.items()))
        if report.bodies:
            console.print(_body_table(report))
        for line in _facts(report):
            console.print(line, markup=False)

    def speed(self, speed: CheckSpeed) -> None:
        """Of the exact check."""
        where = f"among {speed.obstacles} boxes" if speed.obstacles else "with itself alone"
        self.line(
            f"check {where}: {1e6 * speed.seconds:.0f} us a configuration, {1e6 * speed.free_seconds:.0f} us a free "
            f"one ({100 * speed.free_share:.0f} % are)"
        )

    def bounds(self, bounds: BoundsReport) -> None:
        """Of the collision bounds."""
        how = "built" if bounds.built else "at hand, read"
        self.line(
            f"collision bounds: {bounds.spheres} spheres around the bodies and {bounds.inner_spheres} inside, {how} in "
            f"{bounds.seconds:.1f} s; among {bounds.obstacles} boxes they decide {100 * bounds.decided_share:.1f} % of "
            f"{bounds.configurations} configurations in {1e6 * bounds.state_seconds:.1f} us each"
        )

    def findings(self, report: RobotReport, verdict: str) -> None:
        """What is to be done, and what follows from it."""
        self._console.print()
        for finding in report.findings:
            colour = _COLOURS[finding.severity]
            self._console.print(f"[{colour}]{finding.severity.value}[/{colour}] {finding.topic}: ", end="")
            self.line(finding.sentence)
        self._console.print(f"[bold]{verdict}[/bold]")

    def line(self, text: str) -> None:
        """As it is."""
        self._console.print(text, markup=False)


def _joint_table(report: RobotReport) -> Table:
    table = Table(
        "joint", "kind", "limits", "velocity", "acceleration", "moves the tool", box=None, padding=(0, 2, 0, 0)
    )
    for joint in report.joints:
        marks = {name: " (default)" if name in joint.defaults else "" for name in ("velocity", "acceleration")}
        table.add_row(
            joint.name,
            joint.kind,
            "one turn either way" if joint.kind == "continuous" else f"{joint.lower:.4g} to {joint.upper:.4g}",
            f"{joint.velocity:.3g}{marks['velocity']}",
            f"{joint.acceleration:.3g}{marks['acceleration']}",
            "yes" if joint.moves_tool else "no",
        )
    return table


def _body_table(report: RobotReport) -> Table:
    table = Table("link", "collision geometry", "triangles", r"size \[m]", box=None, padding=(0, 2, 0, 0))
    for body in report.bodies:
        size = " x ".join(f"{edge:.3f}" for edge in body.size)
        fixed = "" if body.moves else ", never moves: not checked against obstacles"
        table.add_row(body.link, body.kind + fixed, str(body.triangles or ""), size)
    return table


def _facts(report: RobotReport) -> Iterator[str]:
    if report.inverse_kinematics is not None:
        found = report.inverse_kinematics
        recovered = "" if found.recovered is None else f", with the right branch {found.recovered}"
        yield (
            f"inverse kinematics: {found.method}; {found.solved} of {found.poses} poses solved{recovered}, "
            f"{found.solutions:.1f} solutions and {1e3 * found.seconds:.2f} ms a pose"
        )
    if report.reach is not None:
        box = " x ".join(f"[{a:.2f}, {b:.2f}]" for a, b in zip(report.reach.lower, report.reach.upper, strict=True))
        yield (
            f"reach: the tool gets {report.reach.distance:.2f} m from its first joint (at most "
            f"{report.reach.bound:.2f}), within {box} m"
        )
    if report.self_collision is not None:
        pairs = report.self_collision
        counts = ", ".join(f"{len(pairs.of_kind(kind))} {kind.value.lower()}" for kind in PairKind)
        yield (
            f"self-collision: {len(pairs.pairs)} pairs of links ({counts}); {100 * pairs.free_share:.1f} % of "
            f"{pairs.samples} random configurations are free, {100 * pairs.proposed_free_share:.1f} % with the SRDF "
            "proposed"
        )
        often = sorted(pairs.of_kind(PairKind.SOMETIMES), key=lambda pair: -pair.share)[:5]
        if often:
            listed = ", ".join(f"{a} and {b} {100 * pair.share:.1f} %" for pair in often for a, b in [pair.links])
            yield f"  collide most: {listed}"
