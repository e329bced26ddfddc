"""Covers: balls around bodies hold all of them, balls inside lie in them, whatever the geometry."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from bsp_informed_planner.collision.cover import Cover, CoverBuilder, CoverOptions
from bsp_informed_planner.collision.solid_kernels import (
    DOUBTFUL,
    balls_around,
    crossing,
    distance_to,
    grid_winding,
    is_outermost,
    nearest_among,
    ray_grid,
    solid_angle_winding,
    winding_bounds,
)
from bsp_informed_planner.collision.solids import Body, Solid, body_of
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.scene.pose import FloatArray

OPTIONS = CoverOptions(protrusions=(0.04, 0.012), medial_samples=150)


def item(geometry: coal.CollisionGeometry, seed: int = 0) -> pin.GeometryObject:
    pin.seed(seed)
    return pin.GeometryObject("g", 1, 0, pin.SE3.Random(), geometry)


def mesh(triangles: FloatArray) -> coal.CollisionGeometry:
    points, corners = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(triangles), len(points))
    vertices, indices = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    vertices.extend(list(points))
    for a, b, c in np.asarray(corners).reshape(-1, 3).tolist():
        indices.append(coal.Triangle(a, b, c))
    model.addSubModel(vertices, indices)
    model.endModel()
    return model


def leaves(cover: Cover) -> FloatArray:
    return cover.outer[cover.ends == np.arange(len(cover.ends)) + 1]


@njit
def ray_winding(point: FloatArray, triangles: FloatArray) -> float:
    """By the crossings of a ray, with every triangle looked at; -1 if one is not certain."""
    total = 0
    for i in range(len(triangles)):
        crossed = crossing(point, triangles, i)
        if crossed == DOUBTFUL:
            return -1.0
        total += crossed
    return float(abs(total))


def outermost_one_by_one(triangles: FloatArray, offset: float) -> np.ndarray:
    """As `is_outermost`, with every triangle looked at for every point."""
    found = []
    for a, b, c in triangles:
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        windings = []
        for place, share in ((a, 0.9), (b, 0.9), (c, 0.9), (a, 0.0)):
            for shift in (-offset, offset):
                point = (1.0 - share) * (a + b + c) / 3.0 + share * place + shift * normal
                winding = ray_winding(point, triangles)
                windings.append(solid_angle_winding(point, triangles) if winding < 0.0 else winding)
        found.append(min(windings) < 0.5)
    return np.array(found)


def in_balls(points: FloatArray, balls: FloatArray) -> np.ndarray:
    return np.asarray((np.linalg.norm(points[:, None] - balls[None, :, :3], axis=2) <= balls[:, 3] + 1e-9).any(axis=1))


def points_of(geometry: coal.CollisionGeometry, placement: pin.SE3, rng: np.random.Generator) -> FloatArray:
    """Points of a convex body: random mixtures of support points."""
    support = []
    for _ in range(60):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        if isinstance(geometry, coal.Sphere):
            support.append(geometry.radius * direction)
        elif isinstance(geometry, coal.Box):
            support.append(np.sign(direction) * np.asarray(geometry.halfSide))
        elif isinstance(geometry, coal.Ellipsoid):
            support.append(np.asarray(geometry.radii) * direction)
        elif isinstance(geometry, coal.Capsule):
            support.append(geometry.radius * direction + [0, 0, geometry.halfLength * np.sign(direction[2])])
        else:
            flat = geometry.radius * direction[:2] / np.linalg.norm(direction[:2])
            top = [0.0, 0.0] if isinstance(geometry, coal.Cone) else flat
            support.append(np.append(flat, -geometry.halfLength))
            support.append(np.append(top, geometry.halfLength))
    corners = np.array(support)
    weights = rng.dirichlet(np.full(len(corners), 0.05), 4000)
    points = np.concatenate([corners, weights @ corners])
    return points @ placement.rotation.T + placement.translation


@pytest.mark.parametrize(
    "geometry",
    [
        coal.Box(0.1, 0.06, 0.2),
        coal.Sphere(0.07),
        coal.Capsule(0.03, 0.2),
        coal.Cylinder(0.05, 0.15),
        coal.Cone(0.06, 0.15),
        coal.Ellipsoid(0.03, 0.05, 0.1),
        coal.Box(0.002, 0.2, 0.1),
    ],
    ids=lambda geometry: type(geometry).__name__,
)
def test_primitives(geometry: coal.CollisionGeometry) -> None:
    placed = item(geometry)
    builder = CoverBuilder([body_of(placed, 0.02)], OPTIONS)
    builder.build()
    cover = builder.cover()
    rng = np.random.default_rng(1)
    points = points_of(geometry, placed.placement, rng)
    assert in_balls(points, leaves(cover)).all()
    # No ball stands out by more than it may: its farthest points are that close to the body.
    directions = rng.normal(size=(100, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    probe = coal.Sphere(1e-9)
    for ball in leaves(cover)[:40]:
        for direction in directions[:20]:
            place = pin.SE3(np.eye(3), ball[:3] + ball[3] * direction)
            request, result = coal.DistanceRequest(), coal.DistanceResult()
            a, b = coal.Transform3s(place.rotation, place.translation), placed.placement
            gap = coal.distance(probe, a, geometry, coal.Transform3s(b.rotation, b.translation), request, result)
            assert gap <= OPTIONS.protrusions[-1] + 1e-6
    # Points of the balls inside are points of the body.
    inner = cover.inner
    assert len(inner) or geometry.computeVolume() < 1e-4
    for ball in inner[:20]:
        for direction in directions[:20]:
            place = placed.placement.actInv(ball[:3] + 0.999999 * ball[3] * direction)
            result = coal.CollisionResult()
            transforms = coal.Transform3s(np.eye(3), place), coal.Transform3s.Identity()
            assert coal.collide(probe, transforms[0], geometry, transforms[1], coal.CollisionRequest(), result)


def test_nodes_hold_what_their_leaves_are_for() -> None:
    builder = CoverBuilder([body_of(item(coal.Box(0.1, 0.06, 0.2)), 0.02)], OPTIONS)
    builder.build()
    stack = [builder.root]
    while stack:
        node = stack.pop()
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        for cell in node.cells[:50]:
            assert (np.linalg.norm(cell[:3] + cell[3] * corners - node.ball[:3], axis=1) <= node.ball[3]).all()
        if node.children:
            assert sum(len(child.cells) for child in node.children) == len(node.cells)
            stack.extend(node.children)


def test_sharpened_leaves_still_cover() -> None:
    geometry = coal.Box(0.1, 0.06, 0.2)
    placed = item(geometry)
    builder = CoverBuilder([body_of(placed, 0.02)], OPTIONS)
    builder.build()
    before = builder.leaves()
    for leaf in before[:5]:
        builder.sharpen(leaf, 0.5 * leaf.protrusion)
    after = builder.leaves()
    assert len(after) > len(before)
    points = points_of(geometry, placed.placement, np.random.default_rng(3))
    assert in_balls(points, leaves(builder.cover())).all()


def cup(open_top: bool = True) -> FloatArray:
    """A box without its upper face, or with it."""
    from bsp_informed_planner.collision.solids import _triangles
    from bsp_informed_planner.scene.convex_polytope import box_polytope

    triangles = _triangles(box_polytope([0.1, 0.1, 0.16]))
    if not open_top:
        return triangles
    return triangles[~(triangles[:, :, 2] > 0.0799).all(axis=1)]


def test_open_meshes_are_covered_where_they_wind_around() -> None:
    solid = Solid(cup())
    edges, length = solid.open_edges
    assert len(edges) == 4
    assert length == pytest.approx(0.4)
    builder = CoverBuilder([Body((solid,), np.empty((0, 4)))], OPTIONS)
    builder.build()
    cover = builder.cover()
    rng = np.random.default_rng(4)
    points = rng.uniform([-0.06, -0.06, -0.09], [0.06, 0.06, 0.12], (3000, 3))
    inside = np.array([solid_angle_winding(p, solid.triangles) > 0.5 for p in points])
    assert 500 < inside.sum() < 2500
    assert in_balls(points[inside], leaves(cover)).all()
    surface = np.array([a @ rng.dirichlet(np.ones(3)) for a in solid.triangles.transpose(0, 2, 1) for _ in range(200)])
    assert in_balls(surface, leaves(cover)).all()


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6))
def test_winding_bounds_hold(seed: int) -> None:
    """Around a mesh that is not closed: in a ball clear of the surface the winding number stays within the bounds."""
    rng = np.random.default_rng(seed)
    solid = Solid(cup())
    centre = rng.uniform(-0.2, 0.2, 3)
    radius = 0.9 * distance_to(centre, solid.triangles, np.empty(3))
    low, high = winding_bounds(centre, radius, solid.triangles, solid.grid, *solid.open_edges)
    for _ in range(50):
        direction = rng.normal(size=3)
        point = centre + radius * rng.random() * direction / np.linalg.norm(direction)
        assert low - 1e-9 <= solid_angle_winding(point, solid.triangles) <= high + 1e-9


def test_rays_and_solid_angles_agree() -> None:
    geometry = ur5().collision_model.geometryObjects[3]
    triangles = body_of(geometry, 0.01).solids[0].triangles
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    grid, found = ray_grid(triangles), set()
    for point in np.random.default_rng(5).uniform(low, high, (300, 3)):
        winding = round(solid_angle_winding(point, triangles))
        assert ray_winding(point, triangles) in (-1.0, winding)
        assert round(grid_winding(point, triangles, grid)) == winding
        found.add(winding)
    assert {0, 1} <= found


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 200), size=st.floats(1e-3, 3.0))
def test_the_nearest_triangle_is_found_by_looking_at_few(seed: int, count: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    triangles = rng.normal(size=(count, 1, 3)) + size * rng.normal(size=(count, 3, 3))
    some = rng.permutation(count)[: 1 + count // 2]
    point, bounds, nearest, expected = 2.0 * rng.normal(size=3), np.empty(count), np.empty(3), np.empty(3)
    chosen = np.ascontiguousarray(triangles[some])
    distance = nearest_among(point, triangles, balls_around(triangles), some, len(some), bounds, nearest)
    assert distance == distance_to(point, chosen, expected)
    np.testing.assert_array_equal(nearest, expected)
    exact = [distance_to(point, triangle[None], expected) for triangle in chosen]
    assert (bounds[: len(some)] <= np.array(exact) * (1.0 + 1e-12)).all()


def test_a_link_of_an_arm() -> None:
    """A mesh with hollow parts inside: its surface, and all that it winds around, is covered."""
    geometry = ur5().collision_model.geometryObjects[4]
    body = body_of(geometry, 0.01)
    builder = CoverBuilder([body], CoverOptions(protrusions=(0.03, 0.01), medial_samples=200))
    builder.build()
    cover = builder.cover()
    triangles = body.solids[0].triangles
    rng = np.random.default_rng(6)
    weights = rng.dirichlet(np.ones(3), (len(triangles), 10))
    assert in_balls((weights @ triangles).reshape(-1, 3), leaves(cover)).all()
    points = rng.uniform(triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1)), (2000, 3))
    inside = np.array([solid_angle_winding(p, triangles) > 0.5 for p in points])
    assert in_balls(points[inside], leaves(cover)).all()
    inner = cover.inner
    assert len(inner) > 5
    assert not in_balls(points[~inside], inner).any()


@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.floats(0.2, 0.95))
def test_triangles_between_inside_and_outside_are_found(seed: int, dropped: int, inner: float) -> None:
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(subdivisions=2)
    shell = np.asarray(ball.triangles)
    # A ball in a ball: what winds twice is no border. Some triangles are missing, some boxes lie across.
    parts = [shell[rng.permutation(len(shell))[dropped:]], inner * shell]
    for _ in range(3):
        box = np.asarray(trimesh.creation.box(rng.uniform(0.1, 2.0, 3)).triangles)
        parts.append(box + rng.uniform(-1.0, 1.0, 3))
    triangles = np.ascontiguousarray(np.concatenate(parts))
    np.testing.assert_array_equal(
        is_outermost(triangles, ray_grid(triangles), 1e-5), outermost_one_by_one(triangles, 1e-5)
    )
