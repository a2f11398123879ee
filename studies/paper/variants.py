"""``python -m studies.paper variants``: median policies on other editions, in Drake, with flux weakening."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import msgspec
import tyro

from sprintlab.api.search import SearchOptions
from sprintlab.cli.output import progress_bar
from sprintlab.core.checks import check_choice
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_bytes
from sprintlab.core.reading import read_bytes
from studies.paper.plan import RESULTS
from studies.paper.record import SearchRecord, read_record, speed_record
from studies.paper.runs import Run, find_runs

if TYPE_CHECKING:
    from sprintlab.evaluation.protocol import ProtocolSettings
    from sprintlab.robots import RobotDescription


@dataclass(frozen=True, kw_only=True)
class Variant:
    """What is other than in the main evaluation.

    Attributes:
        robot: which is driven.
        engine: of the physics.
        motor_model: of the plant.
        title: in a table.
    """

    robot: str = "bp2"
    engine: str = "mujoco"
    motor_model: Any = "refined"
    title: str

    def protocol(self, settings: ProtocolSettings) -> ProtocolSettings:
        """The main protocol with this variant's plant."""
        from sprintlab.plant import on_engine

        plant = replace(settings.plant, motor_model=self.motor_model)
        return replace(settings, plant=on_engine(plant, self.engine))


VARIANTS = {
    "bp2-weak": Variant(robot="bp2-weak", title="weak edition"),
    "bp2-strong": Variant(robot="bp2-strong", title="strong edition"),
    "drake": Variant(engine="drake", title="Drake"),
    "flux-weakening": Variant(motor_model="flux-weakening", title="with flux weakening"),
}


class VariantRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The raw search of one policy in one variant.

    Attributes:
        variant: of ``VARIANTS``.
        policy_sha256: of the policy file.
        robot_fingerprint: of the robot that was driven.
        protocol: settings of the search.
        date: ISO 8601.
        versions: of the packages that ran it.
        raw: the search.
    """

    variant: str
    policy_sha256: str
    robot_fingerprint: str
    protocol: dict[str, Any]
    date: str
    versions: dict[str, str]
    raw: SearchRecord


@dataclass(frozen=True, kw_only=True)
class Variants:
    """Evaluate every kept policy in every variant, where it was not yet; each gets its ``<variant>.json``.

    Attributes:
        results: folder of the results, with the policies of the median seeds.
        only: variants to evaluate; all when left out.
        workers: processes; one a core when left out.
        search: trials and speeds.
    """

    results: tyro.conf.Positional[Path] = RESULTS
    only: tuple[str, ...] = ()
    workers: int | None = None
    search: tyro.conf.FlagCreatePairsOff[SearchOptions] = SearchOptions()

    def run(self) -> int:
        """Evaluate and write.

        Raises:
            SprintlabError: an unknown variant, a folder or policy that is refused, or a failed simulation.
        """
        for name in self.only:
            check_choice("only", name, tuple(VARIANTS))
        protocol = self.search.protocol()
        runs = [run for run in find_runs(self.results) if run.policy.is_file()]
        todo = [(run, name) for run in runs for name in self.only or VARIANTS]
        with progress_bar() as report:
            for number, (run, name) in enumerate(todo):
                report(f"{run.method} in {name}", number / len(todo))
                known = read_variant(run, name)
                if known is None or not _answers(known, run, protocol):
                    record = evaluate_variant(run.policy, name, protocol, self.workers)
                    atomic_write_bytes(_file(run, name), msgspec.json.encode(record) + b"\n")
        return 0


def evaluate_variant(
    policy: Path, name: str, settings: ProtocolSettings, workers: int | None = None
) -> VariantRecord:
    """Search the highest raw speed of a policy in a variant; errors as an evaluation has them."""
    from sprintlab.control import POLICY_LIMIT
    from sprintlab.evaluation.pool import TrialPool, WorkerProcesses
    from sprintlab.evaluation.protocol import run_speed, search_speeds
    from sprintlab.robots import load_robot, robot_fingerprint
    from studies.paper.measure import policy_digest, versions

    variant = VARIANTS[name]
    robot, protocol = load_robot(variant.robot), variant.protocol(settings)
    with TemporaryDirectory() as folder, WorkerProcesses(workers) as processes:
        kept = Path(folder) / "policy.onnx"  # another file may take the policy's place meanwhile
        atomic_write_bytes(kept, read_bytes(policy, POLICY_LIMIT, what="policy file"))
        path = kept if variant.robot == "bp2" else moved_policy(kept, robot, Path(folder))
        digest = policy_digest(kept)
        pool = TrialPool(path, robot, processes=processes)
        speeds = search_speeds(
            protocol,
            lambda speed: speed_record(run_speed(pool, speed, self_paced=False, settings=protocol)),
        )
    return VariantRecord(
        variant=name,
        policy_sha256=digest,
        robot_fingerprint=robot_fingerprint(robot),
        protocol=msgspec.to_builtins(protocol),
        date=datetime.now().astimezone().isoformat(timespec="seconds"),
        versions=versions(),
        raw=SearchRecord(speeds=speeds),
    )


def moved_policy(policy: Path, robot: RobotDescription, folder: Path) -> Path:
    """A copy of a policy file whose contract names another edition of its robot.

    A policy refuses a robot with other motors, and rightly; here just that is the question.

    Raises:
        SprintlabError: the robots differ in more than name, motors and what follows from them.
    """
    import onnx

    from sprintlab.control import CONTRACT_KEY, encode_contract, load_policy, read_again
    from sprintlab.control.contract import robot_section

    loaded, section = load_policy(policy), robot_section(robot)
    contract = loaded.contract
    free = {"robot_name", "motors", "robot_fingerprint"}
    other = [name for name, value in section.items() if getattr(contract, name) != value and name not in free]
    if other:
        raise SprintlabError(f"{policy} is no policy of an edition of {robot.name}: see {', '.join(other)}")
    model = onnx.load_from_string(read_again(policy, loaded))
    changed = msgspec.structs.replace(contract, **section)
    onnx.helper.set_model_props(model, {CONTRACT_KEY: encode_contract(changed)})
    path = folder / f"{robot.name}.onnx"
    onnx.save(model, path)
    return path


def _file(run: Run, name: str) -> Path:
    return run.folder / f"{name}.json"


def read_variant(run: Run, name: str) -> VariantRecord | None:
    """What was found in a variant; ``None`` where nothing is, nothing of this version or another variant."""
    try:
        record = read_record(_file(run, name), VariantRecord)
    except SprintlabError:
        return None
    return record if record.variant == name else None


def variant_speeds(runs: Iterable[Run]) -> dict[str, dict[str, float]]:
    """Method to variant to the most that its kept policy holds [m/s], where it was measured."""
    speeds: dict[str, dict[str, float]] = {}
    for run in runs:
        for name in VARIANTS:
            record = read_variant(run, name)
            if record is not None:
                speeds.setdefault(run.method, {})[name] = record.raw.most_held
    return speeds


def _answers(record: VariantRecord, run: Run, settings: ProtocolSettings) -> bool:
    """Whether a record is what evaluating again would give."""
    from sprintlab.robots import load_robot, robot_fingerprint
    from studies.paper.measure import policy_digest, versions

    variant = VARIANTS[record.variant]
    return (
        record.policy_sha256 == policy_digest(run.policy)
        and record.robot_fingerprint == robot_fingerprint(load_robot(variant.robot))
        and record.protocol == msgspec.json.decode(msgspec.json.encode(variant.protocol(settings)))
        and record.versions == versions()
    )
