"""Options of the decomposition."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.scene.polytopes import CURVE_TOLERANCE


def _check(option: str, value: float, valid: bool, expected: str) -> None:
    if not (valid and math.isfinite(value)):
        raise InvalidOptionError(option, value, expected)


@dataclass(frozen=True)
class BspOptions:
    """How partition planes are chosen.

    At each node the plane of least cost is taken:

        cost = split_weight * (facets that it splits) + imbalance_weight * |facets in front - facets behind|
               - area_weight * (share of its facets in the area of all facets of the cell)
               - coplanar_weight * (number of its facets).

    The last term decides whether keypoints mean anything: it makes the planes that several obstacles share, such as the
    front of a shelf, come early, so that they cut openings out as portals.

    Attributes:
        split_weight, imbalance_weight, area_weight, coplanar_weight: see above, not negative.
        plane_tolerance: a facet is moved onto the plane of a larger one if that is at most so far away [m]. Cells may
            overlap obstacles by as much.
        gap_tolerance: the same for facets that move outwards, which only enlarges the obstacle: closes gaps under
            things that stand on a board [m].
        maximum_candidates: planes that are examined at a node, at most. Fewer are faster and split more facets.
    """

    split_weight: float = 8.0
    imbalance_weight: float = 0.2
    area_weight: float = 50.0
    coplanar_weight: float = 20.0
    plane_tolerance: float = 1e-4
    gap_tolerance: float = 1e-3
    maximum_candidates: int = 256

    def __post_init__(self) -> None:
        for option in ("split_weight", "imbalance_weight", "area_weight", "coplanar_weight"):
            value = getattr(self, option)
            _check(option, value, value >= 0.0, "a number of at least 0")
        for option in ("plane_tolerance", "gap_tolerance"):
            value = getattr(self, option)
            _check(option, value, 0.0 <= value <= 0.01, "a length from 0 to 0.01 m")
        _check("maximum_candidates", self.maximum_candidates, self.maximum_candidates >= 1, "at least 1")


@dataclass(frozen=True)
class DecompositionOptions:
    """What is decomposed, and where keypoint candidates go.

    Attributes:
        dimension: 3, or 2 for the plane z = section_height, in which every obstacle is its cross-section.
        section_height: [m].
        curve_tolerance: how far the polytope that stands for a curved obstacle may stand out of it [m].
        grid: candidates along each direction of a portal (in 2D: along the portal). Odd grids contain its centre.
        portal_margin: least distance of candidates from the edges of their portal [m]; if none has it, the centroid is
            the only candidate. None: 0.02 m in 3D, 0 in 2D.
        minimum_portal_width: narrower portals get no candidate [m].
        clearance_cap: distances of candidates from obstacles are measured up to this [m].
        bsp: how partition planes are chosen.
    """

    dimension: int = 3
    section_height: float = 0.0
    curve_tolerance: float = CURVE_TOLERANCE
    grid: int = 3
    portal_margin: float | None = None
    minimum_portal_width: float = 1e-3
    clearance_cap: float = 0.12
    bsp: BspOptions = field(default_factory=BspOptions)

    def __post_init__(self) -> None:
        _check("dimension", self.dimension, self.dimension in (2, 3), "2 or 3")
        _check("section_height", self.section_height, True, "a finite number")
        _check("curve_tolerance", self.curve_tolerance, self.curve_tolerance > 0.0, "a positive length")
        _check("grid", self.grid, self.grid >= 1, "at least 1")
        _check("portal_margin", self.effective_margin, self.effective_margin >= 0.0, "a length of at least 0")
        width = self.minimum_portal_width
        _check("minimum_portal_width", width, width >= 0.0, "a length of at least 0")
        _check("clearance_cap", self.clearance_cap, self.clearance_cap > 0.0, "a positive length")

    @property
    def effective_margin(self) -> float:
        """`portal_margin`, or its default for the dimension [m]."""
        if self.portal_margin is not None:
            return self.portal_margin
        return 0.02 if self.dimension == 3 else 0.0


@dataclass(frozen=True)
class UpdateOptions:
    """What is partitioned anew when obstacles change, and when everything is.

    Where obstacles have changed, cells are touched. A node of the tree is replaced with all below it if a cell below it
    is touched, and there are few cells below it, or many of them are touched, or its plane has no facet any more.
    Replacing more gives a better tree and takes longer.

    Attributes:
        few_cells: so many cells are few.
        useless_cells: so many cells below a plane without facets are few.
        touched_share: such a share of touched cells is many.
        replaced_share: if more of the cells are to be replaced, everything is.
        growth: everything is replaced once there are this many times as many cells as there were when everything was
            replaced last.
        changed_share: everything is replaced once so many convex parts of obstacles have changed since it was replaced
            last, relative to their number.
    """

    few_cells: int = 8
    useless_cells: int = 32
    touched_share: float = 0.5
    replaced_share: float = 0.5
    growth: float = 1.5
    changed_share: float = 0.5

    def __post_init__(self) -> None:
        for option in ("few_cells", "useless_cells"):
            value = getattr(self, option)
            _check(option, value, value >= 1, "at least 1")
        for option in ("touched_share", "replaced_share", "changed_share"):
            value = getattr(self, option)
            _check(option, value, value >= 0.0, "a number of at least 0")
        _check("growth", self.growth, self.growth >= 1.0, "a number of at least 1")
