"""Scenes as one line of JSON, for datasets: the content of a scene file, without what is default."""

from __future__ import annotations

import json
from typing import Any

from bsp_informed_planner.errors import SceneFormatError
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.scene.yaml_io import pose_content, scene_content, scene_from_node
from bsp_informed_planner.scene.yaml_node import YamlFile, YamlNode

# As text, so that a -0.0 counts as another number.
_IDENTITY = repr(pose_content(Pose.identity()))


def scene_to_json(scene: Scene) -> str:
    """A scene as compact JSON; `scene_from_json` gives exactly the same numbers back."""
    return json.dumps(_without_identities(scene_content(scene)), separators=(",", ":"), ensure_ascii=False)


def scene_from_json(text: str, name: str = "<json>") -> Scene:
    """The scene in a text of `scene_to_json`.

    Args:
        text: the JSON.
        name: where it is from, for messages.

    Raises:
        SceneFormatError: naming the place, if it is none.
        InvalidObstacleError: if the numbers of an obstacle make no body.
    """
    try:
        content = json.loads(text)
    except ValueError as error:
        raise SceneFormatError(name, str(error)) from error
    return scene_from_node(YamlNode(content, "", YamlFile(name, None)))


def _without_identities(content: dict[str, Any]) -> dict[str, Any]:
    for obstacle in content["obstacles"]:
        for part in (obstacle, *obstacle["shapes"]):
            if repr(part["pose"]) == _IDENTITY:
                del part["pose"]
    return content
