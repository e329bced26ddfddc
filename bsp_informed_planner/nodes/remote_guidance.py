"""Guidance from the inference node, for the planner node's worker threads."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from bsp_informed_planner_msgs.srv import EstimateKeypoints, SampleConfigurations
from rclpy.client import Client
from rclpy.lifecycle import LifecycleNode

from bsp_informed_planner.errors import NO_MODEL, PlanningCancelledError
from bsp_informed_planner.nodes.arrays import float64_field, rows, uint32_field
from bsp_informed_planner.nodes.error_codes import BEHIND, ErrorCode
from bsp_informed_planner.nodes.own_thread import OwnThread
from bsp_informed_planner.nodes.plan_jobs import CANCEL_PERIOD
from bsp_informed_planner.nodes.qos import SERVICES
from bsp_informed_planner.sampling.guidance import ConfigurationChain, Guidance
from bsp_informed_planner.scene.pose import FloatArray

#: Configurations asked for at once.
BATCH = 256
#: Chains asked for.
MAX_CHAINS = 16
#: Pause before asking an inference node again that is behind with the scene [s].
RETRY_SECONDS = 0.01
#: How long the first plans wait for a service that has never been there [s]: it may not have been heard of yet.
DISCOVERY_SECONDS = 1.0


class InferenceUnavailableError(Exception):
    """The inference node is missing, late, or answers for another scene; the text says which."""


class RemoteGuide:
    """Client of `estimate_keypoints` and `sample_configurations`.

    Its methods wait, and are called from worker threads alone, never from a callback.

    Args:
        node: owns the clients.
        timeout: longest wait for one answer [s]; may be changed.
    """

    def __init__(self, node: LifecycleNode, timeout: float) -> None:
        self.timeout = timeout
        # Until when it is waited for services that are not there; None: nobody has asked yet.
        self._discovery_end: float | None = None
        self._answers = OwnThread(node, "guidance")
        self._estimate = self._answers.client(EstimateKeypoints, "estimate_keypoints", SERVICES)
        self._sample = self._answers.client(SampleConfigurations, "sample_configurations", SERVICES)

    def close(self) -> None:
        """Destroy the clients."""
        self._answers.close()

    def guide(
        self,
        sampler_id: str,
        start: FloatArray,
        goals: FloatArray,
        epoch: int,
        revision: int,
        seed: int,
        seconds: float,
        cancelled: Callable[[], bool] | None = None,
    ) -> Guidance:
        """Chains and a sampler for one problem.

        Args:
            sampler_id: asked for; the inference node may serve another one, and says why.
            start: (n,).
            goals: (k, n).
            epoch, revision: of the scene that the guidance must be for.
            seed: of the samples.
            seconds: longest wait [s].
            cancelled: asked while waiting.

        Raises:
            InferenceUnavailableError: saying why there is none.
            PlanningCancelledError: cancelled while waiting.
        """
        begin = time.monotonic()
        end = begin + min(seconds, self.timeout)
        request = EstimateKeypoints.Request(
            start=float64_field(start),
            goals=float64_field(goals),
            joints=len(start),
            max_chains=MAX_CHAINS,
            model=sampler_id,
            seed=seed,
            scene_epoch=epoch,
            scene_revision=revision,
        )
        answer = self._call(self._estimate, request, end, cancelled)
        chains, offsets = _chains(answer, len(start))
        template = SampleConfigurations.Request(
            configurations=answer.configurations,
            joints=len(start),
            chain_offsets=uint32_field(offsets),
            count=BATCH,
            model=answer.model,
            seed=seed,
            scene_epoch=epoch,
            scene_revision=revision,
        )
        first = _samples(self._call(self._sample, template, end, cancelled), len(start))
        sampler = RemoteSampler(self._sample, template, first)
        # A chain without keypoints is for the sampler alone: the straight line has been tried before.
        chains = tuple(chain for chain in chains if len(chain.configurations) > 2)
        return Guidance(answer.model, chains, sampler, answer.message, time.monotonic() - begin)

    def ask_for_model(self, sampler_id: str, ends: FloatArray, on_missing: Callable[[str], None]) -> bool:
        """Find out whether the inference node has a model, without waiting for its answer.

        Args:
            sampler_id: of the model.
            ends: (2, n) two configurations, between which it draws a sample.
            on_missing: told why there is none, from another thread.

        Returns:
            whether the inference node is there to be asked.
        """
        if not self._sample.service_is_ready():
            return False

        def on_answer(future: Any) -> None:
            answer = future.result()
            if answer is not None and answer.message.startswith(NO_MODEL):
                on_missing(f"{sampler_id}: {answer.message}")

        offsets = uint32_field(np.array([0, 2]))
        request = SampleConfigurations.Request(
            configurations=float64_field(ends), joints=ends.shape[1], chain_offsets=offsets, count=1, model=sampler_id
        )
        self._sample.call_async(request).add_done_callback(on_answer)
        return True

    def _call(self, client: Client, request: Any, end: float, cancelled: Callable[[], bool] | None) -> Any:
        """Wait for an answer, in a worker thread."""
        while True:
            answer = self._call_once(client, request, end, cancelled)
            known = int(answer.scene_epoch), int(answer.scene_revision)
            behind = known < (request.scene_epoch, request.scene_revision)
            if answer.error_code not in BEHIND or not behind or time.monotonic() + RETRY_SECONDS >= end:
                break
            # The scene reached this node first; it is on its way to the other.
            time.sleep(RETRY_SECONDS)
        if answer.error_code != ErrorCode.SUCCESS:
            raise InferenceUnavailableError(f"{client.srv_name}: {answer.message}")
        return answer

    def _require(self, client: Client, end: float, cancelled: Callable[[], bool] | None) -> None:
        """Wait for a service, if this node is new; one that was there, or has been waited for, is gone."""
        while not client.service_is_ready():
            now = time.monotonic()
            if self._discovery_end is None:
                self._discovery_end = now + DISCOVERY_SECONDS
            if now >= min(self._discovery_end, end):
                raise InferenceUnavailableError(f"service {client.srv_name} is not there")
            if cancelled is not None and cancelled():
                raise PlanningCancelledError
            time.sleep(RETRY_SECONDS)
        if client is self._sample:
            self._discovery_end = 0.0

    def _call_once(self, client: Client, request: Any, end: float, cancelled: Callable[[], bool] | None) -> Any:
        self._require(client, end, cancelled)
        future = client.call_async(request)
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        while not done.wait(min(CANCEL_PERIOD, max(end - time.monotonic(), 0.0))):
            late = time.monotonic() >= end
            if late or (cancelled is not None and cancelled()):
                client.remove_pending_request(future)
                if late:
                    raise InferenceUnavailableError(f"service {client.srv_name} did not answer in time")
                raise PlanningCancelledError
        answer = future.result()
        if answer is None:
            raise InferenceUnavailableError(f"service {client.srv_name} gave no answer")
        return answer


def _chains(answer: EstimateKeypoints.Response, joints: int) -> tuple[tuple[ConfigurationChain, ...], np.ndarray]:
    """Chains and offsets of an answer.

    Raises:
        InferenceUnavailableError: if they do not fit together, or are not finite.
    """
    try:
        table = rows(answer.configurations, joints, "configurations")
        offsets = np.array(answer.chain_offsets, dtype=np.int64)
        points = np.array([(point.x, point.y, point.z) for point in answer.keypoints]).reshape(-1, 3)
        if answer.joints != joints or len(points) != len(table) or not np.isfinite(table).all():
            raise ValueError(f"{len(table)} configurations of {answer.joints} joints, {len(points)} keypoints")
        if len(offsets) < 2 or offsets[0] != 0 or offsets[-1] != len(table) or (np.diff(offsets) < 2).any():
            raise ValueError(f"offsets {offsets.tolist()} for {len(table)} configurations")
    except ValueError as error:
        raise InferenceUnavailableError(f"estimate_keypoints answered nonsense: {error}") from error
    chains = tuple(
        ConfigurationChain(table[first:last], points[first:last])
        for first, last in zip(offsets[:-1], offsets[1:], strict=True)
    )
    return chains, offsets


def _samples(answer: SampleConfigurations.Response, joints: int) -> FloatArray:
    """Samples of an answer, (k, joints), k >= 1.

    Raises:
        InferenceUnavailableError: if they are none.
    """
    try:
        table = rows(answer.samples, joints, "samples")
        if answer.joints != joints or not len(table) or not np.isfinite(table).all():
            raise ValueError(f"{len(table)} samples of {answer.joints} joints")
    except ValueError as error:
        raise InferenceUnavailableError(f"sample_configurations answered nonsense: {error}") from error
    return table


class RemoteSampler:
    """Samples drawn by the inference node, asked for ahead and in batches.

    A search waits for a batch only for moments; when the inference node is gone, the samples at hand are drawn again,
    moved a little. While it is there, the same seed gives the same samples.

    Args:
        client: of `sample_configurations`.
        template: the request to repeat.
        pool: (k, n) the first batch, k >= 1.
    """

    #: Longest wait for a batch that is on its way [s].
    PATIENCE = 0.05
    #: Of samples that are drawn again, relative to the spread of the pool.
    JITTER = 0.1

    def __init__(self, client: Client, template: SampleConfigurations.Request, pool: FloatArray) -> None:
        self._client = client
        self._template = template
        self._pool = pool
        self._next = 0
        self._batches = 1
        self._pending = False
        # Whether the batch on its way has been waited for in vain: its node may be gone.
        self._is_late = False
        self._changed = threading.Condition()
        self._request_more()

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        with self._changed:
            if len(self._pool) - self._next < count and not self._is_late:
                self._is_late = not self._changed.wait_for(lambda: not self._pending, self.PATIENCE)
            fresh = self._pool[self._next : self._next + count]
            self._next += len(fresh)
            pool = self._pool
            low = len(self._pool) - self._next < BATCH
        if low:
            self._request_more()
        if len(fresh) == count:
            return fresh.copy()
        again = pool[rng.integers(len(pool), size=count - len(fresh))]
        again = again + rng.normal(size=again.shape) * self.JITTER * pool.std(axis=0)
        return np.concatenate((fresh, again))

    def _request_more(self) -> None:
        with self._changed:
            if self._pending or not self._client.service_is_ready():
                return
            self._pending = True
            # Seeds of their own: the planner's generator must not depend on when answers arrive.
            seed = int(np.random.SeedSequence([self._template.seed, self._batches]).generate_state(1)[0]) or 1
            self._batches += 1
        request = SampleConfigurations.Request(
            configurations=self._template.configurations,
            joints=self._template.joints,
            chain_offsets=self._template.chain_offsets,
            count=BATCH,
            model=self._template.model,
            seed=seed,
            scene_epoch=self._template.scene_epoch,
            scene_revision=self._template.scene_revision,
        )
        self._client.call_async(request).add_done_callback(self._on_answer)

    def _on_answer(self, future: Any) -> None:
        answer = future.result()
        with self._changed:
            self._pending = self._is_late = False
            self._changed.notify_all()
            if answer is None or answer.error_code != ErrorCode.SUCCESS:
                return
            try:
                batch = _samples(answer, self._pool.shape[1])
            except InferenceUnavailableError:
                return
            self._pool = np.concatenate((self._pool[self._next :], batch))
            self._next = 0
