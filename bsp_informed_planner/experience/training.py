"""The training loop of all networks (Algorithm 1): checkpoints, resume, early stopping, several devices.

Everything random follows from the seed and the number of the step, so that a training that was interrupted and goes on
ends with the same weights as one that was not (on the same number of devices).
"""

from __future__ import annotations

import copy
import json
import logging
import math
import os
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.distributed import all_reduce, barrier, destroy_process_group, init_process_group, is_initialized
from torch.nn.parallel import DistributedDataParallel
from torch.utils.tensorboard import SummaryWriter

from bsp_informed_planner.errors import InvalidOptionError, TrainingError
from bsp_informed_planner.networks.runtime import limit_threads

logger = logging.getLogger(__name__)

CHECKPOINT = "checkpoint.pt"
Batch = dict[str, Tensor]


class Examples(Protocol):
    """Where batches come from."""

    def __len__(self) -> int:
        """Number of examples."""
        ...

    def batch(self, indices: NDArray[np.int64], rng: np.random.Generator | None) -> Batch:
        """Examples as tensors on the CPU. `rng`: for augmentation and noise; None: plain, as for validation."""
        ...


@dataclass(frozen=True)
class TrainingOptions:
    """How a network is trained.

    Attributes:
        steps: of the optimiser (AdamW), at most.
        batch_size: examples a step, on all devices together.
        learning_rate: the largest; it rises over `warmup` steps and then falls to zero as a cosine.
        weight_decay: of AdamW.
        warmup: number of steps.
        gradient_norm: gradients are cut to this norm.
        validate_every: steps between validations, after each of which a checkpoint is written.
        patience: the training ends after so many validations without a better one; 0: never early.
        seed: of everything random.
        device: "cpu" or "cuda"; several processes started by torchrun share the work.
        threads: of torch, in each process.
    """

    steps: int = 2000
    batch_size: int = 64
    learning_rate: float = 2e-3
    weight_decay: float = 1e-4
    warmup: int = 200
    gradient_norm: float = 1.0
    validate_every: int = 100
    patience: int = 0
    seed: int = 0
    device: str = "cpu"
    threads: int = 1

    def __post_init__(self) -> None:
        for name in ("steps", "batch_size", "validate_every", "threads"):
            if getattr(self, name) < 1:
                raise InvalidOptionError(name, getattr(self, name), "at least 1")
        for name in ("learning_rate", "gradient_norm"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise InvalidOptionError(name, getattr(self, name), "a positive number")
        for name in ("weight_decay", "warmup", "patience", "seed"):
            if not 0 <= getattr(self, name) < math.inf:
                raise InvalidOptionError(name, getattr(self, name), "at least 0")
        if self.device not in ("cpu", "cuda"):
            raise InvalidOptionError("device", self.device, "cpu or cuda")
        if self.device == "cuda" and not torch.cuda.is_available():
            raise InvalidOptionError("device", self.device, "cpu: torch finds no CUDA device here")

    def learning_rate_at(self, step: int) -> float:
        """The learning rate of a step, counted from 0."""
        rise = min(1.0, (step + 1) / self.warmup) if self.warmup else 1.0
        return self.learning_rate * rise * 0.5 * (1.0 + math.cos(math.pi * step / self.steps))


@dataclass(frozen=True)
class TrainingState:
    """What is reported after each step and each validation.

    Attributes:
        step: number of steps done.
        loss: of the last step.
        validation: the values of the last validation by name; empty before the first.
        best: the least validation loss so far, and the step at which it was.
    """

    step: int
    loss: float
    validation: Mapping[str, float] = field(default_factory=dict)
    best: tuple[float, int] = (math.inf, 0)


@dataclass(frozen=True)
class TrainingResult:
    """The end of a training.

    Attributes:
        steps: that were done.
        best_step: after which the weights were best; those are in the network now.
        validation: the values of that validation.
        seconds: of all runs together [s].
        finished: False if it was interrupted; the same call goes on from the checkpoint.
    """

    steps: int
    best_step: int
    validation: Mapping[str, float]
    seconds: float
    finished: bool = True


def train(
    objective: nn.Module,
    training: Examples,
    validation: Examples,
    options: TrainingOptions,
    out: Path,
    identity: Mapping[str, Any],
    report: Callable[[TrainingState], None] = lambda state: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> TrainingResult:
    """Train until the steps are done, or validation stops improving; leaves the best weights in the objective.

    Args:
        objective: its forward takes a batch and gives a mapping of scalars, of which "loss" is minimised.
        training, validation: examples of both splits.
        options: see there.
        out: folder of checkpoint and TensorBoard curves. A checkpoint in it is continued.
        identity: JSON values that say what is trained on what; a checkpoint of another identity is refused.
        report: told of every step.
        should_stop: asked after every step; True writes a checkpoint and ends.

    Raises:
        TrainingError: without examples, for a checkpoint of another training, if the loss is not finite, or if a
            checkpoint cannot be written.
    """
    with _devices(options) as devices:
        return _Training(objective, training, validation, options, out, identity, devices).run(report, should_stop)


@dataclass(frozen=True)
class _Devices:
    """This process among those that train together."""

    device: torch.device
    rank: int = 0
    size: int = 1


def _devices(options: TrainingOptions) -> AbstractContextManager[_Devices]:
    limit_threads(options.threads)
    if "RANK" not in os.environ:
        return nullcontext(_Devices(torch.device(options.device)))
    return _ProcessGroup(options)


class _ProcessGroup(AbstractContextManager[_Devices]):
    """Joins the processes that torchrun has started."""

    def __init__(self, options: TrainingOptions) -> None:
        self._cuda = options.device == "cuda"

    def __enter__(self) -> _Devices:
        init_process_group("nccl" if self._cuda else "gloo")
        local = int(os.environ.get("LOCAL_RANK", "0"))
        device = torch.device("cuda", local) if self._cuda else torch.device("cpu")
        if self._cuda:
            torch.cuda.set_device(device)
        return _Devices(device, int(os.environ["RANK"]), int(os.environ["WORLD_SIZE"]))

    def __exit__(self, *error: object) -> None:
        destroy_process_group()


class _Training:
    """One call of `train`."""

    def __init__(
        self,
        objective: nn.Module,
        training: Examples,
        validation: Examples,
        options: TrainingOptions,
        out: Path,
        identity: Mapping[str, Any],
        devices: _Devices,
    ) -> None:
        if not len(training) or not len(validation):
            raise TrainingError(
                f"{len(training)} examples for training, {len(validation)} for validation: nothing to do"
            )
        if options.batch_size % devices.size:
            raise InvalidOptionError("batch_size", options.batch_size, f"a multiple of the {devices.size} processes")
        if len(validation) < devices.size:
            raise TrainingError(
                f"{len(validation)} examples for validation cannot be shared by {devices.size} processes"
            )
        self._objective = objective.to(devices.device)
        self._training, self._validation = training, validation
        self._options, self._devices = options, devices
        self._out = out
        relevant = {k: v for k, v in asdict(options).items() if k not in ("device", "threads")}
        self._identity = json.dumps({**identity, "options": relevant, "processes": devices.size}, sort_keys=True)
        self._optimiser = torch.optim.AdamW(
            self._objective.parameters(), lr=options.learning_rate, weight_decay=options.weight_decay
        )
        self._step = 0
        self._best: tuple[float, int] = (math.inf, 0)
        self._best_values: dict[str, float] = {}
        self._best_weights: dict[str, Tensor] = {}
        self._worse = 0
        self._seconds = 0.0

    def run(self, report: Callable[[TrainingState], None], should_stop: Callable[[], bool]) -> TrainingResult:
        options, devices = self._options, self._devices
        self._resume()
        model = self._objective if devices.size == 1 else DistributedDataParallel(self._objective)
        begin, before = time.monotonic(), self._seconds
        writer = SummaryWriter(str(self._out / "tensorboard"), purge_step=self._step) if devices.rank == 0 else None
        values = dict(self._best_values)
        try:
            while self._step < options.steps and not self._is_over:
                terms = self._train_step(model)
                self._seconds = before + time.monotonic() - begin
                if writer is not None:
                    for name, value in terms.items():
                        writer.add_scalar(f"training/{name}", value, self._step)
                stopped = self._any(should_stop())
                if self._step % options.validate_every == 0 or self._step == options.steps:
                    values = self._validate()
                    if writer is not None:
                        for name, value in values.items():
                            writer.add_scalar(f"validation/{name}", value, self._step)
                    self._save()
                elif stopped:
                    self._save()
                report(TrainingState(self._step, terms["loss"], values, self._best))
                if stopped:
                    return TrainingResult(self._step, self._best[1], self._best_values, self._seconds, finished=False)
        finally:
            if writer is not None:
                writer.close()
        self._objective.load_state_dict(self._best_weights)
        return TrainingResult(self._step, self._best[1], self._best_values, self._seconds)

    @property
    def _is_over(self) -> bool:
        return 0 < self._options.patience <= self._worse

    def _train_step(self, model: nn.Module) -> dict[str, float]:
        options, devices = self._options, self._devices
        model.train()
        size = options.batch_size
        rng = np.random.default_rng([options.seed, 1, self._step, devices.rank])
        # Dropout and the like draw from torch's own generator.
        torch.manual_seed(int(rng.integers(2**63)))
        indices = self._indices(self._step * size, size)[devices.rank :: devices.size]
        batch = self._training.batch(indices, rng)
        for group in self._optimiser.param_groups:
            group["lr"] = options.learning_rate_at(self._step)
        self._optimiser.zero_grad(set_to_none=True)
        terms = model({name: tensor.to(devices.device) for name, tensor in batch.items()})
        terms["loss"].backward()
        nn.utils.clip_grad_norm_(self._objective.parameters(), options.gradient_norm)
        values = {name: float(value.detach()) for name, value in terms.items()}
        if not math.isfinite(values["loss"]):
            raise TrainingError(
                f"the loss of step {self._step + 1} is {values['loss']}: a lower learning rate may help; "
                "the checkpoint before is kept"
            )
        self._optimiser.step()
        self._step += 1
        return values

    def _indices(self, first: int, count: int) -> NDArray[np.int64]:
        """Examples `first` to `first + count` of an endless row of permutations, one an epoch."""
        size = len(self._training)
        found = []
        while count > 0:
            epoch, begin = divmod(first, size)
            order = np.random.default_rng([self._options.seed, 0, epoch]).permutation(size)
            found.append(order[begin : begin + count])
            first, count = first + len(found[-1]), count - len(found[-1])
        return np.concatenate(found)

    @torch.no_grad()
    def _validate(self) -> dict[str, float]:
        """Means over all validation examples, shared out among the processes; notes the best weights."""
        self._objective.eval()
        devices, size = self._devices, self._options.batch_size
        mine = np.arange(len(self._validation))[devices.rank :: devices.size]
        sums: dict[str, Tensor] = {}
        count = torch.zeros(1, dtype=torch.float64, device=devices.device)
        torch.manual_seed(0)
        for begin in range(0, len(mine), size):
            indices = mine[begin : begin + size]
            batch = self._validation.batch(indices, None)
            terms = self._objective({name: tensor.to(devices.device) for name, tensor in batch.items()})
            for name, value in terms.items():
                sums[name] = sums.get(name, torch.zeros_like(count)) + len(indices) * value.double()
            count += len(indices)
        if devices.size > 1:
            for tensor in (count, *(sums[name] for name in sorted(sums))):
                all_reduce(tensor)
        values = {name: float(total / count) for name, total in sums.items()}
        if values["loss"] < self._best[0]:
            self._best, self._worse = (values["loss"], self._step), 0
            self._best_values = values
            self._best_weights = copy.deepcopy(self._objective.state_dict())
        else:
            self._worse += 1
        return values

    def _any(self, flag: bool) -> bool:
        """Whether any of the processes says so: all of them must end together."""
        if self._devices.size == 1:
            return flag
        tensor = torch.tensor([float(flag)], device=self._devices.device)
        all_reduce(tensor)
        return bool(tensor.item() > 0.0)

    def _save(self) -> None:
        if self._devices.rank == 0:
            content = {
                "identity": self._identity,
                "step": self._step,
                "weights": self._objective.state_dict(),
                "optimiser": self._optimiser.state_dict(),
                "best": self._best,
                "best_values": self._best_values,
                "best_weights": self._best_weights,
                "worse": self._worse,
                "seconds": self._seconds,
            }
            path = self._out / CHECKPOINT
            temporary = path.with_suffix(".tmp")
            try:
                torch.save(content, temporary)
                temporary.replace(path)
            except (OSError, RuntimeError) as error:
                temporary.unlink(missing_ok=True)
                raise TrainingError(f"{path}: cannot be written: {error}; the one before is kept") from error
        if is_initialized():
            barrier()

    def _resume(self) -> None:
        path = self._out / CHECKPOINT
        try:
            self._out.mkdir(parents=True, exist_ok=True)
            if not path.exists():
                return
            content = torch.load(path, map_location=self._devices.device, weights_only=True)
        except Exception as error:
            raise TrainingError(f"{path}: cannot be read: {error}") from error
        if content["identity"] != self._identity:
            raise TrainingError(f"{path} is of another training{_difference(content['identity'], self._identity)}")
        self._step = content["step"]
        self._objective.load_state_dict(content["weights"])
        self._optimiser.load_state_dict(content["optimiser"])
        self._best, self._best_values = tuple(content["best"]), content["best_values"]
        self._best_weights, self._worse = content["best_weights"], content["worse"]
        self._seconds = content["seconds"]
        logger.info("going on after step %d of %s", self._step, path)


def _difference(found: str, expected: str) -> str:
    """Names the first value in which two identities differ."""
    theirs, mine = json.loads(found), json.loads(expected)
    for name in sorted(theirs.keys() | mine.keys()):
        first, second = theirs.get(name), mine.get(name)
        if first != second and isinstance(first, dict) and isinstance(second, dict):
            inner = next(key for key in sorted(first.keys() | second.keys()) if first.get(key) != second.get(key))
            name, first, second = f"{name}.{inner}", first.get(inner), second.get(inner)
        if first != second:
            return f": its {name} is {first}, not {second}; choose another folder"
    return ""
