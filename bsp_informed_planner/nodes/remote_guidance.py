"""Guidance from the inference node, for the planner node's worker threads."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
from bsp_informed_planner_msgs.srv import EstimateKeypoints, SampleConfigurations
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.lifecycle import LifecycleNode

from bsp_informed_planner.nodes.arrays import float64_field, rows, uint32_field
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.sampling.guidance import ConfigurationChain, Guidance
from bsp_informed_planner.sampling.keypoint_guide import SAMPLER_ID
from bsp_informed_planner.scene.pose import FloatArray

#: Configurations asked for at once.
BATCH = 256
#: Pause before asking an inference node again that is behind with the scene [s].
RETRY_SECONDS = 0.01

_BEHIND = (ErrorCode.MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE, ErrorCode.COLLISION_CHECKING_UNAVAILABLE)


class InferenceUnavailableError(Exception):
    """The inference node is missing, late, or answers for another scene; the text says which."""


class RemoteGuide:
    """Client of `estimate_keypoints` and `sample_configurations`.

    Its methods wait, and are called from worker threads alone, never from a callback of the executor.

    Args:
        node: owns the clients.
        timeout: longest wait for one answer [s].
    """

    def __init__(self, node: LifecycleNode, timeout: float) -> None:
        group = ReentrantCallbackGroup()
        self._node = node
        self._timeout = timeout
        self._estimate = node.create_client(EstimateKeypoints, "estimate_keypoints", callback_group=group)
        self._sample = node.create_client(SampleConfigurations, "sample_configurations", callback_group=group)

    def close(self) -> None:
        """Destroy the clients."""
        self._node.destroy_client(self._estimate)
        self._node.destroy_client(self._sample)

    def guide(self, start: FloatArray, goals: FloatArray, revision: int, seed: int, seconds: float) -> Guidance:
        """Chains and a sampler for one problem.

        Args:
            start: (n,).
            goals: (k, n).
            revision: of the scene that the guidance must be for.
            seed: of the samples.
            seconds: longest wait [s].

        Raises:
            InferenceUnavailableError: saying why there is none.
        """
        begin = time.monotonic()
        request = EstimateKeypoints.Request(
            start=float64_field(start),
            goals=float64_field(goals),
            joints=len(start),
            max_chains=4,
            seed=seed,
            scene_revision=revision,
        )
        answer = self._call(self._estimate, request, min(seconds, self._timeout))
        table = rows(answer.configurations, int(answer.joints), "configurations")
        points = np.array([(point.x, point.y, point.z) for point in answer.keypoints]).reshape(-1, 3)
        offsets = list(answer.chain_offsets)
        chains = tuple(
            ConfigurationChain(table[first:last], points[first:last])
            for first, last in zip(offsets[:-1], offsets[1:], strict=True)
        )
        template = SampleConfigurations.Request(
            configurations=float64_field(table),
            joints=len(start),
            chain_offsets=uint32_field(np.array(offsets)),
            count=BATCH,
            seed=seed,
            scene_revision=revision,
        )
        first = self._call(self._sample, template, max(self._timeout - (time.monotonic() - begin), 0.01))
        sampler = RemoteSampler(self._sample, template, rows(first.samples, len(start), "samples"))
        return Guidance(SAMPLER_ID, chains, sampler, seconds=time.monotonic() - begin)

    def _call(self, client: Client, request: Any, seconds: float) -> Any:
        """Wait for an answer: in a worker thread, while the executor's threads go on."""
        begin = time.monotonic()
        if not client.service_is_ready():
            raise InferenceUnavailableError(f"service {client.srv_name} is not there")
        future = client.call_async(request)
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        if not done.wait(seconds):
            client.remove_pending_request(future)
            raise InferenceUnavailableError(f"service {client.srv_name} did not answer within {seconds:.2f} s")
        answer = future.result()
        if answer.error_code in _BEHIND and begin + seconds - time.monotonic() > RETRY_SECONDS:
            # The scene reached this node first; it is on its way to the other.
            time.sleep(RETRY_SECONDS)
            return self._call(client, request, begin + seconds - time.monotonic())
        if answer.error_code != ErrorCode.SUCCESS:
            raise InferenceUnavailableError(f"{client.srv_name}: {answer.message}")
        return answer


class RemoteSampler:
    """Samples drawn by the inference node, asked for ahead and in batches.

    A search never waits for them: while a batch is on its way, or the inference node is gone, those at hand are drawn
    again, moved a little.

    Args:
        client: of `sample_configurations`.
        template: the request to repeat.
        pool: (k, n) the first batch, k >= 1.
    """

    #: Relative to the spread of the pool.
    JITTER = 0.1

    def __init__(self, client: Client, template: SampleConfigurations.Request, pool: FloatArray) -> None:
        self._client = client
        self._template = template
        self._pool = pool
        self._next = 0
        self._pending = False
        self._lock = threading.Lock()

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        with self._lock:
            fresh = self._pool[self._next : self._next + count]
            self._next += len(fresh)
            low = len(self._pool) - self._next < count
            pool = self._pool
        if low:
            self._request_more(rng)
        if len(fresh) == count:
            return fresh.copy()
        again = pool[rng.integers(len(pool), size=count - len(fresh))]
        again = again + rng.normal(size=again.shape) * self.JITTER * pool.std(axis=0)
        return np.concatenate((fresh, again))

    def _request_more(self, rng: np.random.Generator) -> None:
        with self._lock:
            if self._pending or not self._client.service_is_ready():
                return
            self._pending = True
        request = SampleConfigurations.Request(
            configurations=self._template.configurations,
            joints=self._template.joints,
            chain_offsets=self._template.chain_offsets,
            count=BATCH,
            seed=int(rng.integers(1, 2**32)),
            scene_revision=self._template.scene_revision,
        )
        self._client.call_async(request).add_done_callback(self._on_answer)

    def _on_answer(self, future: Any) -> None:
        answer = future.result()
        with self._lock:
            self._pending = False
            if answer is not None and answer.error_code == ErrorCode.SUCCESS:
                batch = np.asarray(answer.samples, dtype=np.float64).reshape(-1, self._pool.shape[1])
                self._pool = np.concatenate((self._pool[self._next :], batch))
                self._next = 0
