"""A robot description as models of Pinocchio."""

from __future__ import annotations

import logging

import numpy as np
import pinocchio as pin

from bsp_informed_planner.errors import RobotDescriptionError
from bsp_informed_planner.robots.description import RobotDescription, held_name
from bsp_informed_planner.robots.motion_bound import LARGEST_REACH, reach_of

logger = logging.getLogger(__name__)


def build_models(description: RobotDescription) -> tuple[pin.Model, pin.GeometryModel]:
    """Kinematic tree and collision geometry of a robot, with the pairs of its own bodies that are checked.

    Pairs are all but those of links that a joint connects, of links that cannot move relative to each other, and those
    that the SRDF disables.

    Raises:
        RobotDescriptionError: if Pinocchio cannot read the URDF or a mesh, no joint is left to move, or a geometry
            reaches further than `LARGEST_REACH` from its joint.
    """
    try:
        model = pin.buildModelFromXML(description.urdf)
        collision_model = pin.buildGeomFromUrdfString(model, description.urdf, pin.GeometryType.COLLISION)
    except (ValueError, RuntimeError) as error:
        raise RobotDescriptionError(f"the URDF of '{description.name}' cannot be used: {error}") from error
    if description.locked_joints:
        held = pin.neutral(model)
        joints = []
        for name, value in description.locked_joints.items():
            joint = model.getJointId(held_name(name))
            joints.append(joint)
            held[model.joints[joint].idx_q] = value
        try:
            model, collision_model = pin.buildReducedModel(model, collision_model, joints, held)
        except ValueError as error:
            raise RobotDescriptionError(f"joints of '{description.name}' cannot be held: {error}") from error
    if model.nv == 0:
        raise RobotDescriptionError(f"the URDF of '{description.name}' has no joint that moves")
    if collision_model.ngeoms == 0:
        logger.warning("%s has no collision geometry", description.name)
    for item in collision_model.geometryObjects:
        reach = reach_of(item)
        if not reach <= LARGEST_REACH:
            raise RobotDescriptionError(
                f"a collision geometry of link '{model.frames[item.parentFrame].name}' of '{description.name}' reaches "
                f"{reach:.3g} m from its joint: at most {LARGEST_REACH:g} m are expected"
            )
    _add_self_pairs(model, collision_model, description)
    _warn_of_permanent_contacts(model, collision_model, description.name)
    return model, collision_model


def _add_self_pairs(model: pin.Model, collision_model: pin.GeometryModel, description: RobotDescription) -> None:
    collision_model.removeAllCollisionPairs()
    geometries = list(collision_model.geometryObjects)
    exempt = description.adjacent_links | description.disabled_pairs
    for i, first in enumerate(geometries):
        for j in range(i):
            second = geometries[j]
            links = frozenset((model.frames[first.parentFrame].name, model.frames[second.parentFrame].name))
            if first.parentJoint != second.parentJoint and links not in exempt:
                collision_model.addCollisionPair(pin.CollisionPair(j, i))


def _warn_of_permanent_contacts(
    model: pin.Model, collision_model: pin.GeometryModel, name: str, samples: int = 20
) -> None:
    """Two links that touch in every configuration leave nothing to plan: their pair is missing in the SRDF."""
    rng = np.random.default_rng(0)
    data, geometry_data = model.createData(), collision_model.createData()
    for request in geometry_data.collisionRequests:
        request.enable_contact = True  # without it coal overlooks overlaps of aligned primitives
    candidates = set(range(len(collision_model.collisionPairs)))
    for _ in range(samples):
        if not candidates:
            return
        configuration = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit)
        pin.updateGeometryPlacements(model, data, collision_model, geometry_data, configuration)
        candidates = {k for k in candidates if pin.computeCollision(collision_model, geometry_data, k)}
    if candidates:
        pairs = [collision_model.collisionPairs[k] for k in sorted(candidates)]
        bodies = [model.frames[geometry.parentFrame].name for geometry in collision_model.geometryObjects]
        listed = ", ".join(f"{bodies[pair.first]} and {bodies[pair.second]}" for pair in pairs[:5])
        logger.warning(
            "%s: %d pair(s) of links touch in every configuration tried; the SRDF should disable them (%s%s)",
            name,
            len(pairs),
            listed,
            ", ..." if len(pairs) > 5 else "",
        )
