"""Decompositions of a scene that changes: what no change touches is kept."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from bsp_informed_planner.decomposition.construction import Construction, construct, update
from bsp_informed_planner.decomposition.decomposition import Decomposition, decomposition_of
from bsp_informed_planner.decomposition.facet_set import FacetSet
from bsp_informed_planner.decomposition.facets import decomposed_bounds, read_facets
from bsp_informed_planner.decomposition.options import DecompositionOptions, UpdateOptions
from bsp_informed_planner.decomposition.scene_comparison import ObstacleRecord
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds


class IncrementalDecomposer:
    """Decomposes one scene after another, and keeps what obstacles that have come, gone or moved leave untouched.

    A decomposition means the same as that of `decompose`: the same points are free, up to the tolerances of
    `BspOptions`; all openings between free cells are portals; clearances are distances. Its planes, and so its cells,
    can be others. Obstacles that are equal are recognised, at once if they are the same objects, as they are after
    `bsp_informed_planner.scene.diff.apply`. Everything is replaced when the bounds of the workspace change, or by
    `UpdateOptions`.

    Not for use by several threads at a time.
    """

    def __init__(self, options: DecompositionOptions | None = None, limits: UpdateOptions | None = None) -> None:
        """
        Args:
            options: as for `decompose`; defaults if None.
            limits: how much is replaced; defaults if None.
        """
        self.options = options or DecompositionOptions()
        self.limits = limits or UpdateOptions()
        self._construction: Construction | None = None
        self._bounds: WorkspaceBounds | None = None
        # The obstacles, and their numbers as owners of facets. Numbers of what is gone are given again.
        self._obstacles: Mapping[str, Obstacle] = {}
        self._numbers: dict[str, int] = {}
        self._unused: list[int] = []
        # Of some of the obstacles, for comparisons. One of an object that is not in the scene does not count.
        self._records: dict[str, tuple[Obstacle | None, ObstacleRecord | None]] = {}
        # Since everything was replaced last: changed polytopes; and the cells that there were then.
        self._changes = 0
        self._leaves = 0

    @property
    def replaced_cells(self) -> int:
        """How many cells, free and solid, the last decomposition does not share with the one before."""
        return 0 if self._construction is None else self._construction.replaced_cells

    @property
    def is_rebuilt(self) -> bool:
        """Whether the last decomposition shares no cell with the one before, as one made from scratch."""
        return self._construction is not None and self.replaced_cells == self._construction.leaf_count

    def decompose(self, scene: Scene) -> Decomposition:
        """Decomposes the workspace of a scene.

        Args:
            scene: any; the more of its obstacles were in the scene before, the less it takes.

        Raises:
            InvalidObstacleError: if an obstacle has a shape without volume. The next scene is compared with the one
                before this one.
        """
        begin = time.perf_counter()
        bounds = decomposed_bounds(scene, self.options)
        former = self._construction
        if former is None or (scene.bounds is not self._bounds and scene.bounds != self._bounds):
            facets, scene_seconds = read_facets(scene, self.options), time.perf_counter() - begin
            construction = construct(facets, bounds, self.options)
            self._records.clear()
            self._remember(construction, {name: number for number, name in enumerate(scene.obstacles)}, [], None)
        else:
            changed, numbers, gone_numbers = self._compared(scene)
            if not changed and not gone_numbers:
                construction = replace(
                    former, replaced_cells=0, partition_seconds=0.0, portal_seconds=0.0, graph_seconds=0.0
                )
                self._remember(construction, numbers, self._unused, 0)
                self._obstacles = scene.obstacles
                return decomposition_of(construction, scene, bounds, self.options, time.perf_counter() - begin)
            added = read_facets(Scene.of(changed, scene.bounds), self.options)
            is_gone = np.zeros(len(self._numbers) + len(self._unused), np.bool_)
            is_gone[gone_numbers] = True
            gone = is_gone[former.facets.owners]
            unused = gone_numbers + self._unused
            unused.extend(range(len(is_gone), len(is_gone) + len(changed) - len(unused)))
            numbers.update((obstacle.id, number) for obstacle, number in zip(changed, unused, strict=False))
            added = FacetSet(*added.arrays, np.array(unused, np.int64)[added.owners])
            unused = unused[len(changed) :]
            scene_seconds = time.perf_counter() - begin

            removed = int(np.count_nonzero(gone))
            count, total = max(len(added), removed), len(former.facets) - removed + len(added)
            updated = None
            if self._changes + count <= self.limits.changed_share * total:
                updated = update(former, gone, added, bounds, self.options, self.limits)
            if updated is None or updated.leaf_count > self.limits.growth * self._leaves:
                scene_seconds = time.perf_counter() - begin
                construction = construct(former.facets.exchanged(gone, added), bounds, self.options)
                self._remember(construction, numbers, unused, None)
            else:
                construction = updated
                self._remember(construction, numbers, unused, count)
        self._bounds, self._obstacles = scene.bounds, scene.obstacles
        return decomposition_of(construction, scene, bounds, self.options, scene_seconds)

    def _compared(self, scene: Scene) -> tuple[list[Obstacle], dict[str, int], list[int]]:
        """Obstacles that are new or changed; the numbers of the others; numbers of what is gone."""
        numbers = dict(self._numbers)
        changed: list[Obstacle] = []
        gone: list[int] = []
        for name, obstacle in scene.obstacles.items():
            before = self._obstacles.get(name)
            if before is obstacle:
                continue
            changed.append(obstacle)
            if before is None:
                continue
            record, (recorded, former) = ObstacleRecord.of(obstacle), self._records.get(name, (None, None))
            if former is None or recorded is not before:
                former = ObstacleRecord.of(before)
            self._records[name] = obstacle, record
            if record.matches(former):
                changed.pop()
            else:
                gone.append(numbers[name])
        for name in self._obstacles.keys() - scene.obstacles.keys():
            gone.append(numbers.pop(name))
            self._records.pop(name, None)
        return changed, numbers, gone

    def _remember(
        self,
        construction: Construction,
        numbers: dict[str, int],
        unused: list[int],
        changes: int | None,
    ) -> None:
        """Takes a decomposition for the last one; `changes` is None if it was made from scratch."""
        self._construction, self._numbers, self._unused = construction, numbers, unused
        if changes is None:
            self._changes, self._leaves = 0, construction.leaf_count
        else:
            self._changes += changes
