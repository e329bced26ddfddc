"""Scene files of our own.

An example with everything that may be in one. Only `format` and `bounds` must be there, and of a shape its size:

    format: bsp_informed_planner/scene/1
    frame: base_link                        # planning frame; default: world
    revision: 3                             # default: 0
    bounds: {lower: [-1, -1, -0.1], upper: [1, 1, 1.5]}      # of the workspace [m]
    obstacles:
      - id: table
        pose: {position: [0.6, 0, 0.2], rpy: [0, 0, 0.3]}    # in `frame`; default: identity
        shapes:
          - box: [0.8, 1.2, 0.04]           # full edge lengths [m]
          - cylinder: {radius: 0.03, height: 0.2}            # along z, centred at half height
            pose: {position: [0.3, 0.5, -0.12], orientation: [0, 0, 0, 1]}   # in the obstacle; x, y, z, w
      - id: others
        shapes:
          - sphere: {radius: 0.1}
          - cone: {radius: 0.1, height: 0.2}                 # tip at +z
          - half_space: {normal: [0, 0, 1], offset: 0.1}     # solid where normal . x + offset <= 0
          - convex: {vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]}  # their hull
          - mesh: {vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
                   triangles: [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]}
          - mesh: {file: parts/bracket.stl, scale: 0.001}    # stl, obj, ply or off; in the folder of this file
      - id: measured
        pose: {position: [0.1, 0, 0.9], rpy: [-2, 0, -1.57]}  # e.g. that of the camera
        shapes:
          - point_cloud: {points: [[0, 0, 1], [0.01, 0, 1]], resolution: 0.02}  # all voxels of this edge with a point;
                                            # default: 0.02 [m]
          - point_cloud: {file: cloud.ply}  # npy, ply or xyz; in the folder of this file
    attached:                               # held by the robot; as obstacles, with the pose in the frame of the link
      - id: mug
        link: tool0
        touch_links: [left_finger, right_finger]             # may touch it, beside the link
        shapes: [{cylinder: {radius: 0.04, height: 0.1}}]
    allowed_collisions: [[gripper, table]]  # pairs of links, obstacles or attached bodies that may touch
    problem:                                # optional
      description: into the shelf
      start: [0, -1.57, 1.57, 0, 0, 0]      # [rad or m]
      goals: [[1, -1.57, 1.57, 0, 0, 0]]    # any of these configurations,
      goal_poses: [{position: [0.6, 0, 0.4]}]                # or of these poses of the tool, in `frame`

Keys that are not listed here are errors, and so are repeated ones. Writing and reading a scene back gives exactly the
same numbers; mesh files are written as vertices and triangles, and files of point clouds as points.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bsp_informed_planner.errors import InvalidObstacleError, ProblemError
from bsp_informed_planner.scene.mesh_file import load_cloud_file, load_mesh_file
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import AttachedObstacle, BodyPair, Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import (
    CLOUD_RESOLUTION,
    Box,
    Cone,
    ConvexMesh,
    Cylinder,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)
from bsp_informed_planner.scene.yaml_node import VALUES_PER_SHAPE, YamlNode, parse_yaml, read_text

FORMAT = "bsp_informed_planner/scene/1"

_SHAPE_KEYS = ("box", "sphere", "cylinder", "cone", "convex", "mesh", "point_cloud", "half_space")


def scene_from_yaml(source: str | Path) -> Scene:
    """The scene in a file or a text of our own format.

    Args:
        source: a path, or the text itself. A text has no folder, so that no files can be named in it.

    Raises:
        SceneFormatError: naming the place, if the file is none.
        InvalidObstacleError: if the numbers of an obstacle make no body, or two have the same id.
        InvalidWorkspaceError: if the bounds are none.
    """
    return scene_from_node(_top(source))


def problem_from_yaml(source: str | Path) -> ScenarioProblem:
    """The scene and problem in a file or a text; arguments and errors as for `scene_from_yaml`.

    Raises:
        SceneFormatError: also if there is no `problem` in it, or the problem is none.
    """
    top = _top(source)
    scene = scene_from_node(top)
    node = top.at("problem").mapping(("description", "start", "goals", "goal_poses"))
    goals, poses, text = node.get("goals"), node.get("goal_poses"), node.get("description")
    try:
        return ScenarioProblem(
            scene,
            node.at("start").vector(),
            tuple(goal.vector() for goal in goals.items()) if goals else (),
            tuple(pose_from_node(pose) for pose in poses.items()) if poses else (),
            text.text() if text else "",
        )
    except (ProblemError, ValueError) as error:
        raise node.error(str(error)) from error


def scene_to_yaml(scene: Scene | ScenarioProblem) -> str:
    """The text of a scene, with its problem if it has one, for `scene_from_yaml` and `problem_from_yaml`."""
    problem = scene if isinstance(scene, ScenarioProblem) else None
    content = scene_content(scene.scene if isinstance(scene, ScenarioProblem) else scene)
    if problem is not None:
        content["problem"] = {
            "description": problem.description,
            "start": problem.start.tolist(),
            "goals": [goal.tolist() for goal in problem.goals],
            "goal_poses": [pose_content(pose) for pose in problem.goal_poses],
        }
    return dump_yaml(content)


def scene_content(scene: Scene) -> dict[str, Any]:
    """A scene as plain lists, mappings, numbers and texts; `scene_from_node` reads it."""
    content: dict[str, Any] = {
        "format": FORMAT,
        "frame": scene.frame,
        "revision": scene.revision,
        "bounds": {"lower": scene.bounds.lower.tolist(), "upper": scene.bounds.upper.tolist()},
        "obstacles": [_obstacle_content(obstacle) for obstacle in scene.obstacles.values()],
    }
    if scene.attached:
        content["attached"] = [
            {**_obstacle_content(body.obstacle), "link": body.link, "touch_links": sorted(body.touch_links)}
            for body in scene.attached.values()
        ]
    if scene.allowed_collisions:
        content["allowed_collisions"] = sorted(sorted(pair) for pair in scene.allowed_collisions)
    return content


def dump_yaml(content: dict[str, Any]) -> str:
    """YAML of plain content, in its order."""
    import yaml

    # Anchors would need an alias wherever an object occurs twice; plain repetition is for people.
    dumper = type("Dumper", (getattr(yaml, "CSafeDumper", yaml.SafeDumper),), {"ignore_aliases": lambda *_: True})
    text = yaml.dump(content, Dumper=dumper, sort_keys=False, default_flow_style=None, width=120, allow_unicode=True)
    return str(text)


def save_scene(path: str | Path, scene: Scene | ScenarioProblem) -> None:
    """Writes `scene_to_yaml` to a file."""
    Path(path).write_text(scene_to_yaml(scene), encoding="utf-8")


def scene_from_node(top: YamlNode) -> Scene:
    """`scene_from_yaml` for a file that is parsed already."""
    top.mapping(("format", "frame", "revision", "bounds", "obstacles", "attached", "allowed_collisions", "problem"))
    if top.at("format").value != FORMAT:
        raise top.at("format").error(f"expected '{FORMAT}', got {top.at('format').value!r}")
    bounds_node = top.at("bounds").mapping(("lower", "upper"))
    bounds = WorkspaceBounds(bounds_node.at("lower").vector(3), bounds_node.at("upper").vector(3))
    frame, revision, listed = top.get("frame"), top.get("revision"), top.get("obstacles")
    number = revision.integer() if revision else 0
    if revision and number < 0:
        raise revision.error(f"expected 0 or more, got {number}")
    obstacles = [_obstacle(node) for node in listed.items()] if listed else []
    held, pairs = top.get("attached"), top.get("allowed_collisions")
    scene = Scene.of(obstacles, bounds, frame.text() if frame else "world", number)
    return replace(
        scene,
        attached={body.id: body for body in map(_attached, held.items())} if held else {},
        allowed_collisions=frozenset(map(_pair, pairs.items())) if pairs else frozenset(),
    )


def _top(source: str | Path) -> YamlNode:
    if isinstance(source, Path):
        return parse_yaml(read_text(source), str(source), source.parent)
    return parse_yaml(source, "<text>", None)


def _obstacle(node: YamlNode, more_keys: tuple[str, ...] = ()) -> Obstacle:
    node.mapping(("id", "pose", "shapes", *more_keys))
    name, pose = node.at("id").text(), node.get("pose")
    shapes = []
    for part in node.at("shapes").items():
        part.file.take(VALUES_PER_SHAPE, part.place)
        local = part.mapping((*_SHAPE_KEYS, "pose")).get("pose")
        try:
            shapes.append((_shape(part), pose_from_node(local) if local else Pose.identity()))
        except (ValueError, TypeError) as error:
            raise InvalidObstacleError(name, f"{part.place}: {error}") from error
    try:
        return Obstacle(name, tuple(shapes), pose_from_node(pose) if pose else Pose.identity())
    except (ValueError, TypeError) as error:
        raise InvalidObstacleError(name, f"{node.place}.pose: {error}") from error


def _attached(node: YamlNode) -> AttachedObstacle:
    touch_links = node.get("touch_links")
    links = frozenset(link.text() for link in touch_links.items()) if touch_links else frozenset()
    body = _obstacle(node, ("link", "touch_links"))
    return AttachedObstacle(body, node.at("link").text(), links)


def _pair(node: YamlNode) -> BodyPair:
    names = [name.text() for name in node.items()]
    if len(names) != 2 or names[0] == names[1]:
        raise node.error(f"expected two different names, got {names}")
    return frozenset(names)


def pose_from_node(node: YamlNode) -> Pose:
    """A pose.

    Raises:
        SceneFormatError: if it is none.
        ValueError: if its numbers are none of a pose.
    """
    node.mapping(("position", "orientation", "rpy"))
    position, orientation, rpy = node.get("position"), node.get("orientation"), node.get("rpy")
    if orientation and rpy:
        raise node.error("orientation and rpy exclude each other")
    xyz = position.coordinates("xyz") if position else np.zeros(3)
    if rpy:
        return Pose.from_xyz_rpy(xyz, rpy.vector(3))
    return Pose(xyz, orientation.coordinates("xyzw") if orientation else np.array([0.0, 0.0, 0.0, 1.0]))


def _shape(node: YamlNode) -> Shape:
    kinds = [key for key in _SHAPE_KEYS if node.get(key) is not None]
    if len(kinds) != 1:
        raise node.error(f"expected exactly one of {', '.join(_SHAPE_KEYS)}, got {', '.join(kinds) or 'none'}")
    kind = kinds[0]
    data = node.at(kind)
    if kind == "box":
        return Box(data.vector(3))
    if kind == "sphere":
        return Sphere(data.mapping(("radius",)).at("radius").number())
    if kind in ("cylinder", "cone"):
        data.mapping(("radius", "height"))
        round_shape = Cylinder if kind == "cylinder" else Cone
        return round_shape(data.at("radius").number(), data.at("height").number())
    if kind == "convex":
        return ConvexMesh(data.mapping(("vertices",)).at("vertices").rows("xyz"))
    if kind == "half_space":
        data.mapping(("normal", "offset"))
        return HalfSpace(data.at("normal").vector(3), data.at("offset").number())
    if kind == "point_cloud":
        return _point_cloud(data)
    if data.get("file") is not None:
        data.mapping(("file", "scale"))
        scale = data.get("scale")
        return load_mesh_file(data.at("file"), _scale(scale) if scale else np.ones(3))
    data.mapping(("vertices", "triangles"))
    return Mesh(data.at("vertices").rows("xyz"), data.at("triangles").index_rows("vertex_indices"))


def _point_cloud(node: YamlNode) -> PointCloud:
    node.mapping(("points", "file", "resolution"))
    points, file, resolution = node.get("points"), node.get("file"), node.get("resolution")
    if (points is None) == (file is None):
        raise node.error("expected either points or a file")
    return PointCloud(
        points.rows("xyz") if points else load_cloud_file(node.at("file")),
        resolution.number() if resolution else CLOUD_RESOLUTION,
    )


def _scale(node: YamlNode) -> FloatArray:
    scale = node.vector(3) if isinstance(node.value, list) else np.full(3, node.number())
    if not (np.isfinite(scale).all() and (scale > 0.0).all()):
        raise node.error(f"expected positive factors, got {scale.tolist()}")
    return scale


def pose_content(pose: Pose) -> dict[str, Any]:
    """A pose as plain lists; `pose_from_node` reads it."""
    return {"position": pose.position.tolist(), "orientation": pose.quaternion.tolist()}


def _obstacle_content(obstacle: Obstacle) -> dict[str, Any]:
    shapes = [{**_shape_content(shape), "pose": pose_content(pose)} for shape, pose in obstacle.shapes]
    return {"id": obstacle.id, "pose": pose_content(obstacle.pose), "shapes": shapes}


def _shape_content(shape: Shape) -> dict[str, Any]:
    if isinstance(shape, Box):
        return {"box": shape.size.tolist()}
    if isinstance(shape, Sphere):
        return {"sphere": {"radius": shape.radius}}
    if isinstance(shape, Cylinder):
        return {"cylinder": {"radius": shape.radius, "height": shape.height}}
    if isinstance(shape, Cone):
        return {"cone": {"radius": shape.radius, "height": shape.height}}
    if isinstance(shape, ConvexMesh):
        return {"convex": {"vertices": shape.vertices.tolist()}}
    if isinstance(shape, Mesh):
        return {"mesh": {"vertices": shape.vertices.tolist(), "triangles": shape.triangles.tolist()}}
    if isinstance(shape, PointCloud):
        return {"point_cloud": {"points": shape.points.tolist(), "resolution": shape.resolution}}
    if isinstance(shape, HalfSpace):
        return {"half_space": {"normal": shape.normal.tolist(), "offset": shape.offset}}
    raise TypeError(f"no shape: {shape!r}")
