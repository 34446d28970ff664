# SPDX-License-Identifier: BSD-3-Clause
"""Models as C code: the compiled code against the observer of the package."""

import ctypes
import subprocess

import numpy as np
import pytest

import tokid


@pytest.fixture(scope="module")
def system():
    return tokid.example_system("oscillator", steps=30, process_noise=0.05, measurement_noise=0.05)


def pointer(array):
    return ctypes.c_void_p(array.ctypes.data)


@pytest.mark.parametrize("precision, epsilon", [(np.float64, 2.3e-16), (np.float32, 1.2e-7)])
def test_observer_and_controller(system, tmp_path, precision, epsilon):
    controller = system.lqr(1.0, 0.1, input_rate_weight=0.2)
    single = precision == np.float32
    sizes = system.export_c(tmp_path / "plant.c", controller, single_precision=single)
    assert (sizes.name, sizes.stored_steps) == ("plant", len({a.tobytes() for a in system.A}))
    assert sizes.step.multiplications == 44 and sizes.control.multiplications == 12
    assert sizes.state_bytes == (4 + 2) * np.dtype(precision).itemsize + 8 and sizes.step_missing.divisions == 2
    flags = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, "plant.c", "-o", "plant.so"], cwd=tmp_path, check=True)
    code, state = ctypes.CDLL(str(tmp_path / "plant.so")), np.zeros(sizes.state_bytes, np.uint8)
    code.plant_init(pointer(state))
    observer, held = system.observer(), np.zeros(2)
    random = np.random.default_rng(7)
    u, prediction = np.empty((2, 2), precision)
    for k in range(30):
        held = -controller.K[k] @ observer.state - controller.L[k] @ held
        assert code.plant_control(pointer(state), pointer(u)) == 0
        # sums of at most 8 products, whose errors decay with the observer in some 10 steps
        assert np.allclose(u, held, rtol=0, atol=80 * epsilon * max(1, np.abs(held).max()))
        y = random.standard_normal(2).astype(precision)
        if k % 7 == 6:
            y[k % 2] = np.nan
        held = u.astype(float)  # the input that was applied
        seen = observer.step(held, y.astype(float))
        assert code.plant_step(pointer(state), pointer(u), pointer(y), pointer(prediction), None) == 0
        assert np.allclose(prediction, seen.prediction, rtol=0, atol=80 * epsilon * max(1, np.abs(seen.prediction).max()))


def test_names_and_refusals(system, tmp_path):
    assert system.export_c(tmp_path / "a-b.c", name="mine").name == "mine"
    assert '#include "a-b.h"' in (tmp_path / "a-b.c").read_text() and "mine_init" in (tmp_path / "a-b.h").read_text()
    for arguments, message in (
        ({"path": tmp_path / "no.c", "name": "1st"}, "name: '1st' found"),
        ({"path": tmp_path / "no.c", "name": ""}, "name: '' found"),
        ({"path": tmp_path / "no.c", "controller": system}, "controller: Model found"),
        ({"path": tmp_path / "no.c", "controller": tokid.example_system("oscillator", steps=40).lqr(1.0, 1.0)}, "steps"),
    ):
        with pytest.raises(ValueError, match=message):
            system.export_c(**arguments)
    with pytest.raises(tokid.IoError, match=r"\.c needed"):
        system.export_c(tmp_path / "no.h")
    with pytest.raises(FileNotFoundError):
        system.export_c(tmp_path / "none" / "no.c")
    assert not list(tmp_path.glob("no.*"))
