"""Pages for a browser: what is in them, what their controls do, how they end. No browser is needed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from random_scenes import CUBE

from bsp_informed_planner.decomposition.decomposition import Decomposition, decompose
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import MissingPackageError
from bsp_informed_planner.scene.maze import environment
from bsp_informed_planner.scene.moveit_yaml import load_scene
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.visualization.viewer.decomposition_layer import flat_edges, section_of_loop, some_edges
from bsp_informed_planner.visualization.viewer.decomposition_page import DecompositionPage, show_decomposition
from bsp_informed_planner.visualization.viewer.server import Viewer, set_value

SHELF = Path(__file__).parent.parent / "examples" / "shelf.yaml"


@pytest.fixture
def viewer() -> Iterator[Viewer]:
    pytest.importorskip("viser")
    with Viewer("test", port=0) as page:
        yield page


def shown(page: DecompositionPage) -> dict[str, bool]:
    """The nodes of the layers, and whether they are visible."""
    switches = [
        page.scene.obstacles, page.scene.workspace, page.decomposition.cells, page.decomposition.portals,
        page.decomposition.outer_portals, page.decomposition.candidates, page.decomposition.graph,
        page.chain.keypoints, page.selection.cell, page.selection.portal,
    ]  # fmt: skip
    return {node.name: node.visible for switch in switches for node in switch.nodes}


def shelf() -> tuple[Scene, Decomposition]:
    scene = load_scene(SHELF)
    return scene, decompose(scene)


def test_the_page_is_served(viewer: Viewer) -> None:
    with urllib.request.urlopen(viewer.address, timeout=10.0) as answer:
        assert answer.status == 200
        assert b"<html" in answer.read().lower()


def test_everything_has_a_switch(viewer: Viewer) -> None:
    page = show_decomposition(viewer, *shelf())
    nodes = shown(page)
    assert {name.split("/")[2] for name in nodes if name.startswith("/decomposition")} == {
        "cells", "portals", "outer_portals", "candidates",
    }  # fmt: skip
    assert sum(name.startswith("/scene/obstacles") for name in nodes) == 14
    assert {name for name in nodes if name.startswith("/chain")} == {"/chain/line", "/chain/keypoints"}
    assert not any(name.startswith("/chosen") for name in nodes)
    for switch, part in (
        (page.scene.obstacles, "/scene/obstacles"),
        (page.decomposition.cells, "/decomposition/cells"),
        (page.decomposition.portals, "/decomposition/portals"),
        (page.decomposition.candidates, "/decomposition/candidates"),
        (page.chain.keypoints, "/chain"),
    ):
        set_value(switch.box, False)
        assert not any(visible for name, visible in shown(page).items() if name.startswith(part))
        set_value(switch.box, True)
        assert all(visible for name, visible in shown(page).items() if name.startswith(part))
    assert not any(visible for name, visible in nodes.items() if "outer_portals" in name)


def test_the_graph_is_drawn_once_it_is_asked_for(viewer: Viewer) -> None:
    scene, decomposition = shelf()
    page = show_decomposition(viewer, scene, decomposition)
    assert page.decomposition.graph.nodes == []
    set_value(page.decomposition.graph.box, True)
    (node,) = page.decomposition.graph.nodes
    assert node.visible
    assert len(node.points) == min(decomposition.edge_count, 20_000)
    assert len(some_edges(decomposition, 100)) == 100
    assert len(some_edges(decomposition, 10**6)) == decomposition.edge_count


def test_obstacles_become_transparent(viewer: Viewer) -> None:
    page = show_decomposition(viewer, *shelf())
    set_value(page.scene.opacity, 0.2)
    assert {node.opacity for node in page.scene.obstacles.nodes} == {0.2}
    set_value(page.scene.opacity, 1.0)
    assert {node.opacity for node in page.scene.obstacles.nodes} == {None}


def test_one_cell_and_one_portal_are_chosen(viewer: Viewer) -> None:
    scene, decomposition = shelf()
    page = show_decomposition(viewer, scene, decomposition)
    set_value(page.selection.cell.box, True)
    set_value(page.selection.cell_number, 7)
    cell = int(decomposition.free_cells[7])
    assert f"Cell {cell}" in page.selection.description
    names = {name for name in shown(page) if name.startswith("/chosen/cell")}
    assert {"/chosen/cell/faces", "/chosen/cell/edges", "/chosen/cell/portals/faces"} <= names
    set_value(page.selection.portal.box, True)
    set_value(page.selection.portal_number, 3)
    first, second = decomposition.portal_cells[3]
    assert f"joins cells {first} and {second}" in page.selection.description
    assert {"/chosen/portal/cell_0/faces", "/chosen/portal/cell_1/faces"} <= set(shown(page))
    set_value(page.selection.cell.box, False)
    set_value(page.selection.portal.box, False)
    assert page.selection.description == ""
    assert not any(name.startswith("/chosen") for name in shown(page))


def test_the_chain_follows_its_ends(viewer: Viewer) -> None:
    scene, decomposition = shelf()
    start, goal = np.array([-0.3, 0.0, 0.2]), np.array([-0.3, 0.1, 0.3])
    page = show_decomposition(viewer, scene, decomposition, start, goal)
    assert page.chain.chain is not None
    assert "**0 keypoints**" in page.chain.description
    set_value(page.chain.goal, (0.787, -0.293, 0.603))
    assert len(page.chain.chain.points) > 2
    np.testing.assert_allclose(page.chain.chain.points[-1], [0.787, -0.293, 0.603])
    inside = scene.obstacles[next(iter(scene.obstacles))]
    centre = inside.pose.apply(inside.shapes[0][1].position)
    set_value(page.chain.goal, tuple(centre.tolist()))
    assert page.chain.chain is None
    assert "goal keypoint lies in an obstacle" in page.chain.description
    assert page.chain.keypoints.nodes == []


def test_a_suggested_chain_shows_something(viewer: Viewer) -> None:
    page = show_decomposition(viewer, *shelf())
    assert page.chain.chain is not None
    assert len(page.chain.chain.points) >= 4


def test_a_section_is_flat(viewer: Viewer) -> None:
    maze = environment(2)
    decomposition = decompose(maze.scene, DecompositionOptions(dimension=2))
    page = show_decomposition(viewer, maze.scene, decomposition)
    (cells,) = page.decomposition.cells.nodes
    assert (cells.points[..., 2] == np.float32(decomposition.section_height)).all()
    (portals,) = page.decomposition.portals.nodes
    assert np.ptp(portals.points[..., 2]) == 0.0
    assert page.decomposition.outer_portals.nodes == []
    assert page.chain.chain is not None
    set_value(page.selection.cell.box, True)
    assert "m²" in page.selection.description
    total = 0.0
    for cell in decomposition.free_cells.tolist():
        polytope = decomposition.cell_polytope(cell)
        assert polytope is not None
        total += len(polytope.faces) - 2
    # Each side of each polygon; those that two cells share in full are there once.
    assert 0.5 * total <= len(flat_edges(decomposition)) <= total


def test_an_empty_scene_has_a_page(viewer: Viewer) -> None:
    scene = Scene.of([], CUBE)
    page = show_decomposition(viewer, scene, decompose(scene))
    set_value(page.selection.cell.box, True)
    set_value(page.selection.portal.box, True)
    assert page.decomposition.portals.nodes == []
    assert page.chain.chain is not None


def test_an_upright_polygon_is_cut_at_a_height() -> None:
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 2], [0, 0, 2]])
    loop = np.stack((square, np.roll(square, -1, axis=0)), axis=1)
    cut = section_of_loop(loop, 0.5)
    assert sorted(cut[0, :, 0].tolist()) == [0.0, 1.0]
    assert (cut[0, :, 2] == 0.5).all()
    assert section_of_loop(loop, 3.0).shape == (0, 2, 3)


def test_without_viser_a_sentence_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(MissingPackageError, match="pip install"):
        Viewer("test", port=0)


def test_importing_the_viewer_does_not_import_viser() -> None:
    code = (
        "import sys; import bsp_informed_planner.visualization.viewer.decomposition_page; "
        "sys.exit('viser' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_ctrl_c_ends_the_command() -> None:
    pytest.importorskip("viser")
    command = [sys.executable, "-m", "bsp_informed_planner.cli.app", "decompose", str(SHELF), "--view", "--port", "0"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"}
    )
    assert process.stderr is not None
    line = process.stderr.readline()
    assert line.startswith("open http://localhost:")
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20.0)
    assert process.returncode == 0
    assert err == ""
    assert "free cells" in out
    assert "viser" not in out
