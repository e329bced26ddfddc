"""Two commands make a small model, which plans: what continuous integration shows of the large ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from bsp_informed_planner.cli.app import app
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import JointGoal, PlanningProblem, PlanOptions
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.maze import random_maze


def bsp_planner(words: str) -> None:
    outcome = CliRunner().invoke(app, words.split())
    assert outcome.exit_code == 0, outcome.output


def test_collect_train_and_plan_in_mazes(tmp_path: Path) -> None:
    mazes, models = tmp_path / "mazes", tmp_path / "models"
    bsp_planner(f"collect --robot point --problems 40 --validation 8 --seed 2 --out {mazes}")
    few = "--steps 20 --batch-size 8 --validate-every 10"
    for kind in ("heatmap", "segment_cvae", "cvae_shortest_path"):
        bsp_planner(f"train {mazes} --model {kind} --out {models} {few}")
        (models / "checkpoint.pt").unlink()
    bsp_planner(f"train {mazes} --model gmm --out {models}")
    maze = random_maze(np.random.default_rng(2**50 + 7))
    planner = Planner(PointRobot(), maze.scene, models=str(models))
    for sampler_id in ("learned", "cvae_shortest_path", "gmm"):
        options = PlanOptions("rrt_star", sampler_id, allowed_seconds=20.0, first_solution=True, seed=1)
        result = planner.plan(PlanningProblem(maze.start, [JointGoal(maze.goal)]), options)
        assert result.guidance.sampler_id == sampler_id
