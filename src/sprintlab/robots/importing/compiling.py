"""A model file from elsewhere, compiled in a process of its own that may not take long nor much.

A few lines of MJCF can ask for two million bodies, or for a terrain of 40 GB; MuJoCo would try. The process
has a limit of time, memory and file size, and works in an empty folder; back comes MuJoCo's own binary.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np

from sprintlab.core.errors import RobotModelError, SprintlabError, printable
from sprintlab.core.reading import read_text

MODEL_LIMIT = 16 << 20
"""Largest model file that is read [bytes]."""
LONGEST = 7.0
"""Time of a core that a model may take to compile [s]: with the start of both processes, ten at most."""
_ASLEEP = 2.0  # s without work: it waits at a pipe; where the system does not tell, all time is work
_NAP = 0.02  # s of work that are none
_MEMORY = 6 << 30
_BINARY = 256 << 20
_MOST_BODIES = 500
_MOST_WRAPS = 4000  # of tendons; to pose one takes a time that grows with their square
_STATE = 64 << 20  # bytes of a model's data, which is made anew for each pose that is compared
_ROUNDING = 1e-6  # relative; files are written with six or seven digits
_NUMBERS = (
    "qpos0", "body_pos", "body_quat", "body_ipos", "body_iquat", "body_mass", "body_inertia", "jnt_pos",
    "jnt_axis", "jnt_range", "dof_armature", "dof_damping", "dof_frictionloss", "geom_pos", "geom_quat",
    "geom_size", "actuator_forcerange",
)  # fmt: skip
_LARGEST = 1e12
_READY = "ready"
_CHILD = (
    "import sys; sys.path[:] = sys.argv[3:]; from sprintlab.robots.importing import compiling; "
    "compiling.child(sys.argv[1], sys.argv[2])"
)


def compiled(path: Path) -> tuple[mujoco.MjModel, tuple[str, ...]]:
    """The compiled file, and the links whose inertia had to be corrected for it.

    Raises:
        RobotModelError: the file cannot be read, MuJoCo refuses it, or it would take longer than ``LONGEST``
            or more memory than a robot does.
    """
    read_text(path, MODEL_LIMIT, what="robot model", error=RobotModelError)
    with tempfile.TemporaryDirectory(prefix="sprintlab-") as folder:
        binary = Path(folder) / "model.mjb"
        answer = _answer(path, binary)
        if "refused" in answer:
            raise RobotModelError(f"robot model {path} cannot be used: {printable(answer['refused'])}")
        try:
            return mujoco.MjModel.from_binary_path(str(binary)), tuple(answer["corrected"])
        except (ValueError, KeyError, mujoco.FatalError) as error:
            raise RobotModelError(f"robot model {path} cannot be used: {printable(error)}") from error


def _answer(path: Path, binary: Path) -> dict[str, list[str] | str]:
    """What the process says: names of corrected links, or why it refuses."""
    command = [sys.executable, "-c", _CHILD, str(path.resolve()), str(binary), *filter(None, sys.path)]
    process = subprocess.Popen(
        command,
        cwd=binary.parent,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    with process:
        try:
            assert process.stdout is not None
            process.stdout.readline()  # it has started: a busy machine does not count as a slow model
            _await(process)
            return json.loads(binary.with_suffix(".json").read_bytes())
        except subprocess.TimeoutExpired:
            return {"refused": "its files keep it waiting, or it takes too long to compile"}
        except (OSError, ValueError):  # it was stopped at a limit, or MuJoCo ended it
            most = f"{LONGEST:g} s, {_MEMORY >> 30} GB or the room in {binary.parent.parent}"
            return {"refused": f"to compile, it takes more than {most}"}
        finally:
            process.kill()


def _await(process: subprocess.Popen[str]) -> None:
    """Wait for a process with a limit of its own for work; raises ``TimeoutExpired`` where it does none.

    On a busy machine a core's seconds take longer than the clock's, and what waits at a pipe takes none.
    """
    if sys.platform != "linux":
        process.wait(timeout=LONGEST)
        return
    clock = ~process.pid << 3 | 2  # of its work, as the kernel numbers clocks of other processes
    while process.poll() is None:
        before = time.clock_gettime(clock)
        try:
            process.wait(timeout=_ASLEEP)
        except subprocess.TimeoutExpired:
            if time.clock_gettime(clock) - before < _NAP:
                raise


def child(path: str, binary: str) -> None:
    """The process's work: compile ``path`` into ``binary``; how it went stands beside it as JSON."""
    import resource

    print(_READY, flush=True)
    spent = int(sum(resource.getrusage(resource.RUSAGE_SELF)[:2]))
    for kind, limit in (
        (resource.RLIMIT_CPU, spent + int(LONGEST)),
        (resource.RLIMIT_AS, _MEMORY),
        (resource.RLIMIT_FSIZE, _BINARY),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(kind, (limit, limit))
    try:
        model, corrected = _compile(Path(path))
        if model.nbody > _MOST_BODIES:
            raise ValueError(f"it has {model.nbody} bodies, more than {_MOST_BODIES}")
        if mujoco.mj_sizeModel(model) >= _BINARY:
            raise ValueError(f"it is larger than {_BINARY >> 20} MB, compiled")
        if model.nwrap > _MOST_WRAPS:
            raise ValueError(f"its tendons have {model.nwrap} parts, more than {_MOST_WRAPS}")
        if mujoco.MjData(model).nbuffer > _STATE:
            raise ValueError(f"it has more than {_STATE >> 20} MB of state")
        _check_numbers(model)
        mujoco.mj_saveModel(model, binary, None)
        answer: dict[str, list[str] | str] = {"corrected": list(corrected)}
    except (ElementTree.ParseError, ValueError, SprintlabError, mujoco.FatalError) as error:
        answer = {"refused": " ".join(str(error).split()) or type(error).__name__}
    except (MemoryError, RecursionError) as error:
        answer = {"refused": f"it is larger than a robot ({type(error).__name__})"}
    Path(binary).with_suffix(".json").write_text(json.dumps(answer), encoding="utf-8")
    os._exit(0)


def _compile(path: Path) -> tuple[mujoco.MjModel, tuple[str, ...]]:
    text = read_text(path, MODEL_LIMIT, what="robot model", error=RobotModelError)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ValueError("it defines entities, which no robot needs")
    root = ElementTree.fromstring(text)
    corrected = possible_inertias(root)
    if root.tag == "robot":
        spec = mujoco.MjSpec.from_string(_plain_urdf(root))
    else:
        spec = mujoco.MjSpec.from_file(str(path))
    _drop_meshes(spec)
    return spec.compile(), corrected


def _check_numbers(model: mujoco.MjModel) -> None:
    """Raise ``ValueError`` where a place, a size or a mass is one that MuJoCo takes, and no robot has."""
    for name in _NUMBERS:
        values = np.asarray(getattr(model, name))
        if not (np.abs(values) <= _LARGEST).all():  # NaN is not, either
            raise ValueError(f"its {name} holds a number that is not finite, or beyond {_LARGEST:g}")
    for name in ("body_quat", "body_iquat"):  # of 1e300 in a file MuJoCo makes zero, and the inertia with it
        if (np.abs(np.linalg.norm(getattr(model, name), axis=1) - 1.0) > _ROUNDING).any():
            raise ValueError(f"its {name} holds a quaternion that is not of unit length")


def possible_inertias(root: ElementTree.Element) -> tuple[str, ...]:
    """Raise inertias of a URDF's links that no body can have, in place: published files hold some.

    A body's principal inertias are not negative, and no two add up to less than the third. Where they do, the
    same amount is added to all three: the least that helps and keeps the axes.

    Returns:
        Names of the links that were changed.

    Raises:
        ValueError: an entry is no number.
    """
    changed = []
    for link in root.findall("link"):
        entries = link.find("inertial/inertia")
        if entries is None:
            continue
        xx, yy, zz, xy, xz, yz = (
            float(entries.get(name, 0.0)) for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        )
        if not all(abs(value) < 1e12 for value in (xx, yy, zz, xy, xz, yz)):
            raise ValueError(f"link {link.get('name', '?')} has an inertia that is no finite number")
        low, middle, high = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        lack = max(high - low - middle, -low)
        if lack > _ROUNDING * abs(high):
            for name, value in (("ixx", xx), ("iyy", yy), ("izz", zz)):
                entries.set(name, repr(float(value + (1.0 + _ROUNDING) * lack)))
            changed.append(link.get("name", "?"))
    return tuple(changed)


def _plain_urdf(root: ElementTree.Element) -> str:
    """A URDF without meshes whose links stay apart, so that a foot keeps its name and its mass."""
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            if shape.tag == "visual" or shape.find("geometry/mesh") is not None:
                link.remove(shape)
    for joint in root.findall("joint"):
        if joint.get("type") == "floating":  # the base's: it is found by its legs, and may as well stand
            joint.set("type", "fixed")
    for extension in root.findall("mujoco"):
        root.remove(extension)
    extension = ElementTree.SubElement(root, "mujoco")
    # A URDF link without <inertial> weighs nothing: its shapes are not to be weighed as water.
    settings = {"fusestatic": "false", "balanceinertia": "false", "inertiafromgeom": "false"}
    ElementTree.SubElement(extension, "compiler", settings)
    return ElementTree.tostring(root, encoding="unicode")


def _drop_meshes(spec: mujoco.MjSpec) -> None:
    """Take out mesh shapes where the body's inertia does not depend on them, then meshes nobody uses."""
    for body in spec.bodies:
        for geom in list(body.geoms):
            if geom.type == mujoco.mjtGeom.mjGEOM_MESH and body.explicitinertial:
                spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH}
    for mesh in list(spec.meshes):
        if mesh.name not in used:
            spec.delete(mesh)
