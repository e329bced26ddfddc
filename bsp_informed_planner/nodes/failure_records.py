"""Problems that could not be planned, kept in files for `bsp-planner plan FILE`."""

from __future__ import annotations

import itertools
import logging
import os
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path

from bsp_informed_planner.errors import NodeInactiveError, PlanningCancelledError
from bsp_informed_planner.nodes.world import World
from bsp_informed_planner.planning.problem import PlanningProblem, PlanOptions
from bsp_informed_planner.planning.problem_file import RecordedProblem, save_recorded_problem
from bsp_informed_planner.robots.reference import reference_to

logger = logging.getLogger(__name__)

#: Most files that one node writes: a client that asks for the impossible all day must not fill the disk.
MOST_FILES = 200


class FailureRecords:
    """Writes a file for each plan that fails. Threads may share one.

    Args:
        folder: where; made when first needed. Empty: nothing is written.
    """

    def __init__(self, folder: str) -> None:
        self._folder = Path(folder).expanduser() if folder else None
        self._numbers = itertools.count(1)

    def save(
        self,
        error: Exception,
        world: World | None,
        problem: PlanningProblem | None,
        options: PlanOptions | None,
        seed: int | None,
    ) -> Path | None:
        """Write what failed, as far as it is known. Never raises: a full disk must not cost an answer.

        Args:
            error: what ended the plan.
            world, problem, options: of the plan; nothing is written if one of them is missing.
            seed: that was drawn, if it came so far.

        Returns:
            the file; None if nothing was written.
        """
        if self._folder is None or world is None or problem is None or options is None:
            return None
        if isinstance(error, (PlanningCancelledError, NodeInactiveError)):
            return None
        number = next(self._numbers)
        if number > MOST_FILES:
            return None
        time = datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%S")
        path = self._folder / f"problem-{time}-{os.getpid()}-{number}.yaml"
        try:
            recorded = RecordedProblem(
                robot=reference_to(world.bare_robot),
                scene=world.scene,
                problem=problem,
                options=options if seed is None else replace(options, seed=seed),
                error_kind=type(error).__name__,
                error_message=str(error),
            )
            self._folder.mkdir(parents=True, exist_ok=True)
            save_recorded_problem(path, recorded)
        except Exception:
            logger.exception("%s could not be written", path)
            return None
        return path
