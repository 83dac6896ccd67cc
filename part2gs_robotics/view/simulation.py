"""The twin in MuJoCo while somebody moves it: servos follow a hand, and contacts hold them back."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.assets.model_files import check_model_files
from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.read_twin import read_twin
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.kinematics import moving_parts

if TYPE_CHECKING:
    import mujoco

MODEL = "scene.xml"  # servos, gravity and ground
LONGEST = 0.1  # s advanced at once: after a pause the hand is not thrown through a second of motion


@dataclass(frozen=True)
class Touch:
    """Two bodies in contact: `one` and `other` by name, `depth` in scene units."""

    one: str
    other: str
    depth: float


class Simulation:
    """A twin whose joints have targets.

    Attributes:
        twin: as `twin.yaml` says.  moving: its parts with a joint.
        targets: where each of `moving` is asked to be, rad or scene units.
    """

    def __init__(self, folder: Path) -> None:
        """Compile a twin folder's scene, at state 0.

        Raises:
            CheckError: a file is missing or damaged, or the model lacks a part or servo.
        """
        import mujoco

        self.twin = read_twin(folder)
        self.moving = moving_parts(self.twin)
        check_model_files(folder / MODEL)
        try:
            self.model = mujoco.MjModel.from_xml_path(str(folder / MODEL))
        except ValueError as err:
            raise CheckError(f"{folder / MODEL}: MuJoCo does not compile it ({err}). Expected the "
                             "file that `build` writes; build the twin again.") from err
        self.data = mujoco.MjData(self.model)
        names = [part.name for part in self.twin.parts]
        self._bodies = [self._index(mujoco.mjtObj.mjOBJ_BODY, name, folder) for name in names]
        self._servos = [self._index(mujoco.mjtObj.mjOBJ_ACTUATOR, f"{names[i]}_servo", folder)
                        for i in self.moving]
        self._places = [int(self.model.jnt_qposadr[self.model.actuator_trnid[servo, 0]])
                        for servo in self._servos]
        mujoco.mj_forward(self.model, self.data)
        self._rest = [se3.inverse(self._body_pose(body)) for body in self._bodies]
        self.targets = [0.0] * len(self.moving)

    def ask(self, number: int, target: float) -> None:
        """Ask the joint of `moving[number]` to go somewhere inside its range."""
        low, high = self.twin.parts[self.moving[number]].limits
        self.targets[number] = float(np.clip(target, low, high))

    def advance(self, seconds: float) -> None:
        """Let time pass; at most LONGEST of it."""
        import mujoco

        self.data.ctrl[self._servos] = self.targets
        steps = round(min(seconds, LONGEST) / self.model.opt.timestep)
        mujoco.mj_step(self.model, self.data, nstep=max(1, steps))

    def positions(self) -> list[float]:
        """Return where the joints of `moving` are, rad or scene units."""
        return [float(self.data.qpos[place]) for place in self._places]

    def poses(self) -> list[F64]:
        """Return per part [4, 4] world_now_from_world_at_0."""
        return [self._body_pose(body) @ rest
                for body, rest in zip(self._bodies, self._rest, strict=True)]

    def touching(self) -> tuple[Touch, ...]:
        """Return the pairs of bodies in contact, each once with its deepest contact."""
        found: dict[tuple[str, str], float] = {}
        for contact in self.data.contact[: self.data.ncon]:
            one, other = sorted(self._name(geom) for geom in contact.geom)
            found[one, other] = max(found.get((one, other), 0.0), -float(contact.dist))
        return tuple(Touch(*pair, depth) for pair, depth in found.items())

    def pull(self, number: int, held: F64, hand: F64) -> None:
        """Ask the joint of `moving[number]` to bring a point of its part nearest to the hand.

        To first order: q + v . (hand - held) / |v|^2, v the point's velocity per unit of q.

        Args:
            number: of the joint.
            held: [3] the point, where it is now in the world, scene units.
            hand: [3] where the hand is.
        """
        part = self.twin.parts[self.moving[number]]
        joint = part.joint
        assert joint is not None  # a moving part has one
        carrier = self.poses()[part.parent]
        axis, origin = carrier[:3, :3] @ joint.axis, carrier[:3, :3] @ joint.origin + carrier[:3, 3]
        turn = np.cross(axis, held - origin) if joint.turns else np.zeros(3)
        velocity = turn + axis * (joint.pitch if joint.turns else 1.0)
        square = float(velocity @ velocity)
        if square > 0:  # a point on the axis moves nothing
            self.ask(number, self.positions()[number] + float(velocity @ (hand - held)) / square)

    def _body_pose(self, body: int) -> F64:
        turn = np.asarray(self.data.xmat[body], np.float64).reshape(3, 3)
        return se3.make(turn, np.asarray(self.data.xpos[body], np.float64))

    def _name(self, geom: int) -> str:
        """Return the body of a geom; that of the world is known by its geom."""
        body = int(self.model.geom_bodyid[geom])
        return self.model.body(body).name if body else self.model.geom(geom).name or "world"

    def _index(self, kind: mujoco.mjtObj, name: str, folder: Path) -> int:
        import mujoco

        found = mujoco.mj_name2id(self.model, kind, name)
        if found < 0:
            raise CheckError(f"{folder / MODEL}: has no {name}, which twin.yaml needs. Expected "
                             "both files of one build; build the twin again.")
        return int(found)
