"""Meshes and point clouds that a scene file names."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.shapes import Mesh
from bsp_informed_planner.scene.yaml_node import YamlNode

MAX_FILE_BYTES = 64 * 1024 * 1024
MESH_SUFFIXES = (".stl", ".obj", ".ply", ".off")
CLOUD_SUFFIXES = (".npy", ".ply", ".xyz")


def load_mesh_file(node: YamlNode, scale: FloatArray) -> Mesh:
    """The mesh in the file that a node names, relative to the folder of the scene file and confined to it.

    Args:
        node: with the path.
        scale: (3,) factors that bring the file's coordinates to metres.

    Raises:
        SceneFormatError: if the file lies elsewhere, does not exist, is too large or cannot be read.
        ValueError: if its mesh is no solid.
    """
    path = confined_file(node, MESH_SUFFIXES)
    import trimesh

    try:
        # No materials: they would name further files. Binary, for both kinds of STL.
        with path.open("rb") as stream:
            loaded = trimesh.load(
                stream, file_type=path.suffix[1:].lower(), force="mesh", process=False, skip_materials=True
            )
    except Exception as error:  # trimesh's readers raise whatever a broken file provokes
        raise node.error(f"'{path.name}' cannot be read as a mesh: {error}") from error
    vertices, triangles = np.asarray(loaded.vertices), np.asarray(loaded.faces)
    if not len(vertices) or triangles.ndim != 2:
        raise node.error(f"'{path.name}' holds no triangles")
    return Mesh(vertices * scale, triangles)


def load_cloud_file(node: YamlNode) -> FloatArray:
    """(n, 3) the points in the file that a node names, confined as `load_mesh_file`: of a mesh its vertices.

    Raises:
        SceneFormatError: if the file lies elsewhere, does not exist, is too large or cannot be read.
    """
    path = confined_file(node, CLOUD_SUFFIXES)
    import trimesh

    try:
        if path.suffix.lower() == ".npy":
            # Mapped, so that a header that promises more than the file holds takes no memory.
            points = np.array(np.load(path, mmap_mode="r", allow_pickle=False), dtype=np.float64)
        else:
            with path.open("rb") as stream:
                loaded = trimesh.load(stream, file_type=path.suffix[1:].lower(), process=False)
            points = np.array(loaded.vertices, dtype=np.float64)
    except Exception as error:  # as in `load_mesh_file`
        raise node.error(f"'{path.name}' cannot be read as a point cloud: {error}") from error
    if points.ndim != 2 or points.shape[1] != 3:
        raise node.error(f"'{path.name}' holds an array of shape {points.shape}, expected (n, 3)")
    return points


def confined_file(node: YamlNode, suffixes: tuple[str, ...]) -> Path:
    """The file that a node names, relative to the folder of the scene file and confined to it.

    Args:
        node: with the path.
        suffixes: that the file may have, in lower case.

    Raises:
        SceneFormatError: if the file lies elsewhere, does not exist or is too large.
    """
    name = node.text()
    if node.file.folder is None:
        raise node.error("a text without a folder cannot name files")
    folder = node.file.folder.resolve()
    if "://" in name or "\0" in name or Path(name).is_absolute():
        raise node.error(f"'{name}': expected a path relative to the scene file")
    path = (folder / name).resolve()
    if not path.is_relative_to(folder):
        raise node.error(f"'{name}' lies outside of the folder of the scene file")
    if path.suffix.lower() not in suffixes:
        raise node.error(f"'{name}': expected one of {', '.join(suffixes)}")
    if not path.is_file():
        raise node.error(f"'{name}' does not exist")
    if path.stat().st_size > MAX_FILE_BYTES:
        raise node.error(f"'{name}' is larger than {MAX_FILE_BYTES} bytes")
    return path
