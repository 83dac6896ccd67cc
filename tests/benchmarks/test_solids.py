"""The things of plain solids are what their states say: loadable, jointed, moving apart."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import yaml


@pytest.fixture(scope="module")
def solids(load):
    return load("solids")


def test_every_thing_loads_and_its_parts_move(solids):
    assert len(solids.THINGS) == 20
    for name, make in solids.THINGS.items():
        thing = make()
        model = mujoco.MjModel.from_xml_string(solids.mjcf(name, thing))
        data = mujoco.MjData(model)
        joints = {model.joint(j).name for j in range(model.njnt)}
        assert joints == set(thing.states), name
        places = []
        for state in (0, 1):
            for joint, values in thing.states.items():
                data.qpos[model.joint(joint).qposadr[0]] = values[state]
            mujoco.mj_forward(model, data)
            places.append(np.concatenate([data.geom_xpos, data.geom_xmat], 1).copy())
        moved = np.linalg.norm(places[1] - places[0], axis=1) > 0.01
        parts = {int(b) for b in model.geom_bodyid[moved]}
        assert parts == set(range(2, model.nbody)), name  # world 0, base 1
        assert thing.nested == any(model.body_parentid[b] > 1 for b in parts), name


def test_the_index_names_every_model(solids, tmp_path):
    index = solids.write_models(tmp_path)
    entries = yaml.safe_load(index.read_text())["objects"]
    assert set(entries) == set(solids.THINGS)
    for name, entry in entries.items():
        assert (tmp_path / name / "model.xml").is_file()
        assert all(len(values) == 2 for values in entry["move"].values())
