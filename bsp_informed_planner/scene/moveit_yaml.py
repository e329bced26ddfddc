"""Planning scenes of MoveIt in YAML.

Reads moveit_msgs/PlanningScene (or the part `world: {collision_objects: [...]}` of it, or CollisionObject alone) as
ROS tools print messages, and as MotionBenchMaker and robowflex write them: primitive types by number or name, points
and quaternions as lists or mappings. Everything else in a planning scene (robot state, allowed collisions, colours,
octomap) is ignored, except that attached objects and octomaps that hold something are refused rather than left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bsp_informed_planner.errors import InvalidObstacleError
from bsp_informed_planner.scene.mesh_file import load_mesh_file
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cone, Cylinder, HalfSpace, Mesh, Shape, Sphere
from bsp_informed_planner.scene.yaml_io import scene_from_node
from bsp_informed_planner.scene.yaml_node import VALUES_PER_SHAPE, YamlNode, parse_yaml, read_text

# MoveIt's scenes have no workspace bounds: [m] around the root of a table-top arm.
DEFAULT_BOUNDS = WorkspaceBounds(np.array([-1.5, -1.5, -1.0]), np.array([1.5, 1.5, 2.0]))

# shape_msgs/SolidPrimitive: its name, its number and the number of its dimensions.
_PRIMITIVES = {"box": (1, 3), "sphere": (2, 1), "cylinder": (3, 2), "cone": (4, 2)}


def load_scene(path: str | Path, bounds: WorkspaceBounds | None = None) -> Scene:
    """The scene in a file, of our own format or MoveIt's: which, its top keys tell.

    Args:
        path: the file.
        bounds: of the workspace [m]; None takes the file's own, which MoveIt's have not: `DEFAULT_BOUNDS`.

    Raises:
        SceneFormatError: if the file cannot be read, naming the place.
        InvalidObstacleError: if the numbers of an obstacle make no body, or two have the same id.
        InvalidWorkspaceError: if the bounds in the file are none.
    """
    path = Path(path)
    top = parse_yaml(read_text(path), str(path), path.parent)
    if top.mapping().get("format") is None:
        return _scene(top, bounds)
    scene = scene_from_node(top)
    return scene if bounds is None else replace(scene, bounds=bounds)


def scene_from_moveit_yaml(source: str | Path, bounds: WorkspaceBounds | None = None) -> Scene:
    """The scene in a file (a path) or a text of MoveIt's format; else as `load_scene`."""
    if isinstance(source, Path):
        return _scene(parse_yaml(read_text(source), str(source), source.parent), bounds)
    return _scene(parse_yaml(source, "<text>", None), bounds)


def _scene(top: YamlNode, bounds: WorkspaceBounds | None) -> Scene:
    for wrapper in ("planning_scene", "scene"):
        top = top.get(wrapper) or top
    world = top.get("world") or top
    objects = world.get("collision_objects")
    if objects is None:
        raise top.error("no scene: neither 'format' nor 'world.collision_objects' is there")
    _refuse_what_would_be_lost(top, world)
    nodes = list(objects.items())
    frames = list(dict.fromkeys(frame for frame in map(_frame, nodes) if frame))
    # The frame of the scene: the one that the given transforms lead to, or else the first that an object names.
    transforms = _transforms(top)
    parents = {parent for parent, _ in transforms.values() if parent}
    root = next((frame for frame in frames if frame not in transforms), None) or next(iter(parents), "world")
    obstacles = []
    for node in nodes:
        frame = _frame(node) or root
        obstacle = _obstacle(node)
        if frame != root:
            parent, pose = transforms.get(frame, (None, Pose.identity()))
            if parent != root:
                known = f"the scene is in '{root}', and no fixed_frame_transforms lead there"
                raise node.error(f"obstacle '{obstacle.id}' is in frame '{frame}': {known}")
            obstacle = Obstacle(obstacle.id, obstacle.shapes, pose * obstacle.pose)
        obstacles.append(obstacle)
    return Scene.of(obstacles, bounds or DEFAULT_BOUNDS, root)


def _refuse_what_would_be_lost(top: YamlNode, world: YamlNode) -> None:
    robot_state = top.get("robot_state")
    attached = robot_state.get("attached_collision_objects") if robot_state else None
    if attached and attached.value:
        raise attached.error("attached objects are not supported")
    octomap = world.get("octomap")
    inner = octomap.get("octomap") if octomap else None
    data = inner.get("data") if inner else None
    if data and data.value:
        raise data.error("octomaps are not supported")


def _frame(node: YamlNode) -> str:
    header = node.mapping().get("header")
    frame = header.get("frame_id") if header else None
    return frame.text().lstrip("/") if frame else ""


def _transforms(top: YamlNode) -> dict[str, tuple[str, Pose]]:
    """For each child frame of `fixed_frame_transforms` its parent and its pose there."""
    listed = top.get("fixed_frame_transforms")
    found: dict[str, tuple[str, Pose]] = {}
    for node in listed.items() if listed else ():
        child, transform = node.at("child_frame_id").text().lstrip("/"), node.at("transform")
        parent = _frame(node)
        if parent != child:  # MoveIt lists the planning frame as its own child
            try:
                found[child] = (parent, _pose(transform, "translation", "rotation"))
            except ValueError as error:
                raise transform.error(str(error)) from error
    return found


def _obstacle(node: YamlNode) -> Obstacle:
    id_node = node.mapping().get("id")
    name = id_node.text() if id_node else ""
    operation = node.get("operation")
    if operation and operation.value not in (0, b"\0", "add", "ADD", "\0"):
        raise operation.error(f"obstacle '{name}': only ADD (0) makes sense in a file, got {operation.value!r}")
    shapes: list[tuple[Shape, Pose]] = []
    try:
        for key, poses, read in (
            ("primitives", "primitive_poses", _primitive),
            ("meshes", "mesh_poses", _mesh),
            ("planes", "plane_poses", _plane),
        ):
            shapes.extend(_placed(node, key, poses, read))
        pose_node = node.get("pose")
        pose = _pose(pose_node) if pose_node else Pose.identity()
    except (ValueError, TypeError) as error:
        raise InvalidObstacleError(name, f"{node.place}: {error}") from error
    return Obstacle(name, tuple(shapes), pose)


def _placed(
    node: YamlNode, key: str, poses_key: str, read: Callable[[YamlNode], Shape]
) -> Iterator[tuple[Shape, Pose]]:
    parts, poses = node.get(key), node.get(poses_key)
    part_nodes = list(parts.items()) if parts else []
    pose_nodes = list(poses.items()) if poses else []
    if pose_nodes and len(pose_nodes) != len(part_nodes):
        raise node.error(f"{len(part_nodes)} {key}, but {len(pose_nodes)} {poses_key}")
    for index, part in enumerate(part_nodes):
        part.file.take(VALUES_PER_SHAPE, part.place)
        yield read(part), _pose(pose_nodes[index]) if pose_nodes else Pose.identity()


def _pose(node: YamlNode, position_key: str = "position", orientation_key: str = "orientation") -> Pose:
    position, orientation = node.mapping().get(position_key), node.get(orientation_key)
    xyz = position.coordinates("xyz") if position else np.zeros(3)
    quaternion = orientation.coordinates("xyzw") if orientation else np.zeros(4)
    # Messages that nobody filled in say (0, 0, 0, 0).
    return Pose(xyz, quaternion if quaternion.any() else np.array([0.0, 0.0, 0.0, 1.0]))


def _primitive(node: YamlNode) -> Shape:
    kind_node, size = node.at("type"), node.at("dimensions").vector()
    kind: Any = kind_node.value
    name = str(kind).strip().lower()
    for known, (number, count) in _PRIMITIVES.items():
        if name in (known, str(number)):
            # A bounded array of a message may be longer than its shape needs.
            if len(size) < count:
                raise node.error(f"a {known} has {count} dimensions, got {len(size)}")
            if known == "box":
                return Box(size[:3])
            if known == "sphere":
                return Sphere(float(size[0]))
            height, radius = float(size[0]), float(size[1])
            return Cylinder(radius, height) if known == "cylinder" else Cone(radius, height)
    raise kind_node.error(f"unknown primitive {kind!r} (known: {', '.join(_PRIMITIVES)}, or 1 to 4)")


def _mesh(node: YamlNode) -> Shape:
    resource = node.mapping().get("resource")
    if resource is not None:
        scale = node.get("dimensions")
        return load_mesh_file(resource, scale.vector(3) if scale else np.ones(3))
    return Mesh(node.at("vertices").rows("xyz"), node.at("triangles").index_rows("vertex_indices"))


def _plane(node: YamlNode) -> Shape:
    coefficients = (node.at("coef") if isinstance(node.value, dict) else node).vector(4)
    return HalfSpace(coefficients[:3], float(coefficients[3]))
