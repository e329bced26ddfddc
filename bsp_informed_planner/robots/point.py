"""A point robot in the plane."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from bsp_informed_planner.errors import InvalidOptionError, UnknownFrameError
from bsp_informed_planner.scene.pose import FloatArray, Pose, frozen_array

# coal wants a positive radius; this one is far below any tolerance [m].
POINT_RADIUS = 1e-9


class PointRobot:
    """A point, or a small disc, that moves along x and y in the plane z = 0. See `Robot` for its attributes.

    Its body is a ball, so that scenes are given as for any other robot; obstacles that matter reach through z = 0. The
    height and the orientation of a pose have no meaning for it.
    """

    def __init__(
        self,
        lower: ArrayLike = (0.0, 0.0),
        upper: ArrayLike = (1.0, 1.0),
        radius: float = POINT_RADIUS,
        velocity_limit: float = 1.0,
        acceleration_limit: float = 1.0,
        root_frame: str = "world",
        name: str = "point",
    ) -> None:
        """
        Args:
            lower, upper: (2,) bounds of x and y [m].
            radius: of the ball [m].
            velocity_limit: of x and of y [m/s].
            acceleration_limit: of x and of y [m/s^2].
            root_frame: the frame in which scenes are given.
            name: of the robot.

        Raises:
            InvalidOptionError: if a bound is not finite, lower is not below upper, or a number is not positive.
        """
        try:
            self.lower: FloatArray = frozen_array(lower, (2,))
            self.upper: FloatArray = frozen_array(upper, (2,))
        except ValueError as error:
            raise InvalidOptionError("lower, upper", (lower, upper), "two finite numbers each") from error
        if not (self.lower < self.upper).all():
            raise InvalidOptionError("lower, upper", (lower, upper), "lower below upper")
        numbers = {"radius": radius, "velocity_limit": velocity_limit, "acceleration_limit": acceleration_limit}
        for option, value in numbers.items():
            if not 0.0 < value < np.inf:
                raise InvalidOptionError(option, value, "a positive number")
        self.name = name
        self.radius = float(radius)
        self.joint_names: tuple[str, ...] = ("x", "y")
        self.continuous = np.zeros(2, dtype=np.bool_)
        self.continuous.setflags(write=False)
        self.revolute = self.continuous
        self.velocity_limits: FloatArray = frozen_array([velocity_limit] * 2)
        self.acceleration_limits: FloatArray = frozen_array([acceleration_limit] * 2)
        self.workspace_dimension = 2
        self.root_frame = root_frame
        self.tool_frame = "point"
        self.motion_levers: FloatArray = frozen_array([[1.0, 1.0]])
        self.motion_radii: FloatArray = frozen_array([1.0, 1.0])
        self.model = self._kinematics()
        self.collision_model = pin.GeometryModel()
        self.collision_model.addGeometryObject(
            pin.GeometryObject(
                f"{self.tool_frame}_0",
                self.model.getJointId("y"),
                self.model.getFrameId(self.tool_frame),
                pin.SE3.Identity(),
                coal.Sphere(self.radius),
            )
        )

    def _kinematics(self) -> pin.Model:
        model = pin.Model()
        model.name = self.name
        parent = 0
        for index, joint in enumerate((pin.JointModelPX(), pin.JointModelPY())):
            parent = model.addJoint(
                parent,
                joint,
                pin.SE3.Identity(),
                self.joint_names[index],
                np.zeros(1),
                self.velocity_limits[index : index + 1],
                self.lower[index : index + 1],
                self.upper[index : index + 1],
            )
        model.addFrame(pin.Frame(self.root_frame, 0, 0, pin.SE3.Identity(), pin.FrameType.BODY))
        model.addFrame(pin.Frame(self.tool_frame, parent, 0, pin.SE3.Identity(), pin.FrameType.BODY))
        return model

    @property
    def dof(self) -> int:
        """2."""
        return 2

    @property
    def frames(self) -> tuple[str, ...]:
        """The root frame and the point."""
        return (self.root_frame, self.tool_frame)

    @property
    def orientation_free(self) -> bool:
        """True."""
        return True

    def forward_kinematics(self, configuration: FloatArray, frame: str | None = None) -> Pose:
        """See `Robot.forward_kinematics`."""
        if not self._is_point(frame):
            return Pose.identity()
        x, y = configuration
        return Pose(np.array([x, y, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))

    def reference_points(self, configurations: FloatArray) -> FloatArray:
        """See `Robot.reference_points`."""
        return np.column_stack((configurations, np.zeros(len(configurations))))

    def inverse_kinematics(
        self, pose: Pose, frame: str | None = None, rng: np.random.Generator | None = None
    ) -> FloatArray:
        """The x and y of the pose, (1, 2), or (0, 2) if they are outside the limits. See `Robot.inverse_kinematics`."""
        point = pose.position[:2]
        if not self._is_point(frame) or (point < self.lower).any() or (point > self.upper).any():
            return np.empty((0, 2))
        return point[None].copy()

    def inverse_kinematics_batch(
        self, poses: Sequence[Pose] | FloatArray, frame: str | None = None, rng: np.random.Generator | None = None
    ) -> list[FloatArray]:
        """See `Robot.inverse_kinematics_batch`."""
        if isinstance(poses, np.ndarray):
            poses = [Pose.from_matrix(matrix) for matrix in poses]
        return [self.inverse_kinematics(pose, frame) for pose in poses]

    def windings(self, configuration: FloatArray) -> FloatArray:
        """The configuration itself, (1, 2): it has no joints that turn."""
        return np.array(configuration, dtype=np.float64)[None]

    def _is_point(self, frame: str | None) -> bool:
        if frame not in (None, *self.frames):
            raise UnknownFrameError(str(frame), self.frames)
        return frame != self.root_frame
