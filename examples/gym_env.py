"""A Gymnasium environment around a twin: open a part by commanding the servos of all joints.

    python examples/gym_env.py out/demo part_1      # needs: pip install 'part2gs-robotics[gym]'

Joints count in shares of their ranges, 0 to 1. Observation: positions, speeds per second, and the
goal. Action: where every servo goes, -1 to 1 over its range. Reward: minus the distance to go.
"""

import sys
from pathlib import Path

import gymnasium
import mujoco
import numpy as np

FRAMES = 10  # simulation steps per action: 50 actions a second at MuJoCo's 2 ms
THERE = 0.02  # of the range: so near is the goal reached
STEPS = 200  # actions until an episode is cut off
MOST = 10.0  # of what is observed: nothing sound moves faster than 10 ranges a second


class TwinEnv(gymnasium.Env):
    """Bring one part of a twin to a random goal.

    Args:
        folder: of the twin; its `scene.xml` has a servo on every joint.
        part: the one to move.
        render_mode: "rgb_array" for pictures (without a screen, MUJOCO_GL=egl), or None.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012 - Gymnasium's way

    def __init__(self, folder: str | Path, part: str = "part_1",
                 render_mode: str | None = None) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(Path(folder) / "scene.xml"))
        self.data = mujoco.MjData(self.model)
        self.part = self.model.actuator(f"{part}_servo").id
        joints = self.model.actuator_trnid[:, 0]  # of every servo
        self.low, high = self.model.actuator_ctrlrange.T
        self.span = high - self.low
        self.qpos, self.qvel = self.model.jnt_qposadr[joints], self.model.jnt_dofadr[joints]
        count = len(joints)
        self.observation_space = gymnasium.spaces.Box(-MOST, MOST, (2 * count + 1,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (count,), np.float32)
        self.render_mode = render_mode
        self.renderer: mujoco.Renderer | None = None

    def reset(self, *, seed: int | None = None,
              options: dict[str, object] | None = None) -> tuple[np.ndarray, dict[str, object]]:
        """Start in state 0 of the photos, with a new goal in the part's range."""
        super().reset(seed=seed)
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key("state_0").id)
        mujoco.mj_forward(self.model, self.data)
        self.goal = self.np_random.uniform()
        self.count = 0
        return self._seen(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, object]]:
        """Send the servos somewhere, and simulate FRAMES steps."""
        self.data.ctrl = self.low + (np.asarray(action, float) + 1) / 2 * self.span
        mujoco.mj_step(self.model, self.data, FRAMES)
        self.count += 1
        away = abs(float(self._shares()[self.part]) - self.goal)
        return self._seen(), -away, away < THERE, self.count >= STEPS, {}

    def _shares(self) -> np.ndarray:
        return (self.data.qpos[self.qpos] - self.low) / self.span

    def _seen(self) -> np.ndarray:
        speeds = self.data.qvel[self.qvel] / self.span
        seen = np.concatenate([self._shares(), speeds, [self.goal]])
        return np.clip(seen, -MOST, MOST).astype(np.float32)

    def render(self) -> np.ndarray | None:
        """Return [H, W, 3] uint8: what the twin looks like now."""
        if self.render_mode is None:
            return None
        self.renderer = self.renderer or mujoco.Renderer(self.model)
        self.renderer.update_scene(self.data)
        return self.renderer.render()

    def close(self) -> None:
        """Free the renderer."""
        if self.renderer is not None:
            self.renderer.close()


gymnasium.register("Twin-v0", TwinEnv)  # for gymnasium.make("Twin-v0", folder="out/demo")


def main(folder: str | Path, part: str) -> float:
    """Run one episode with the plainest of policies: go there. Return its last reward."""
    env = TwinEnv(folder, part)
    seen, _ = env.reset(seed=0)
    action = 2 * env._shares() - 1  # all others stay where they are
    action[env.part] = 2 * env.goal - 1
    done = False
    while not done:
        seen, reward, reached, cut, _ = env.step(action)
        done = reached or cut
    print(f"goal {env.goal:.3f}, at {seen[env.part]:.3f} after {env.count} actions")
    return reward


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
