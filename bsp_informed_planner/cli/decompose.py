"""`bsp-planner decompose`."""

from __future__ import annotations

import dataclasses
import itertools
import json
from pathlib import Path

import typer

from bsp_informed_planner.cli.output_files import prepare_output
from bsp_informed_planner.cli.pages import open_viewer, serve
from bsp_informed_planner.compile_kernels import ensure_compiled
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.scene.moveit_yaml import load_scene
from bsp_informed_planner.scene.outside import outside_warning


def run_decompose(
    path: Path, options: DecompositionOptions, as_json: bool, png: Path | None, page: tuple[str, int] | None = None
) -> int:
    """Decompose a scene file, print, draw, serve a page at a host and port. Returns the exit status."""
    if options.grid % 2 == 0:
        expected = "an odd number, so that the centre of each portal is a candidate"
        raise InvalidOptionError("--grid", options.grid, expected)
    scene = load_scene(path)
    prepare_output("--png", png)
    warning = outside_warning(scene)
    if warning:
        typer.echo(f"warning: {warning}", err=True)
    # Loading kernels and libraries is not what the times are about.
    ensure_compiled()
    decompose(scene, options)
    result = decompose(scene, options)
    counts = {
        "obstacles": len(scene.obstacles),
        "facets": result.facet_count,
        "facets_split": result.split_count,
        "free_cells": result.cell_count,
        "portals": result.portal_count,
        "candidates": result.candidate_count,
        "edges": result.edge_count,
    }
    timings = dataclasses.asdict(result.timings)
    if as_json:
        portals = [
            {"corners": result.portal_corners[begin:end].tolist(), "cells": cells.tolist()}
            for (begin, end), cells in zip(
                itertools.pairwise(result.portal_offsets.tolist()), result.portal_cells, strict=True
            )
        ]
        polytopes = {int(cell): result.cell_polytope(int(cell)) for cell in result.free_cells}
        cells = [
            {"cell": cell, "vertices": polytope.vertices.tolist()}
            for cell, polytope in polytopes.items()
            if polytope is not None
        ]
        content = {
            **counts,
            **timings,
            "frame": scene.frame,
            "length_unit": "m",
            "dimension": options.dimension,
            "bounds": {"lower": scene.bounds.lower.tolist(), "upper": scene.bounds.upper.tolist()},
            "warnings": [warning] if warning else [],
            "cells": cells,
            "portal_polygons": portals,
            "candidate_points": result.candidates.tolist(),
            "candidate_portals": result.candidate_portals.tolist(),
            "candidate_clearances": result.candidate_clearances.tolist(),
        }
        typer.echo(json.dumps(content))
    else:
        typer.echo("\n".join(f"{name.replace('_', ' '):<13} {value}" for name, value in counts.items()))
        milliseconds = ", ".join(
            f"{name.removesuffix('_seconds')} {1e3 * value:.2f}" for name, value in timings.items()
        )
        typer.echo(f"{'time [ms]':<13} {1e3 * result.timings.total_seconds:.2f} ({milliseconds})")
    if png is not None:
        from bsp_informed_planner.visualization.figures import draw_decomposition

        draw_decomposition(png, scene, result)
        typer.echo(f"picture: {png}", err=True)
    if page is not None:
        from bsp_informed_planner.visualization.viewer.decomposition_page import show_decomposition

        with open_viewer(f"{path.name}: cells, portals, keypoints", *page) as viewer:
            show_decomposition(viewer, scene, result)
            serve(viewer)
    return 0
