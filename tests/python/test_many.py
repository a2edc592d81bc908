"""Answers of many processes are the same bits as those of one."""

import numpy as np
import pytest
from conftest import SQUARES, SQUARES_FACES

from raybrook import Scene


def closest(rays, scene):
    hits = scene.closest_hits(rays)
    return hits.t.tobytes(), hits.uv.tobytes(), hits.triangle.tobytes()


@pytest.mark.parametrize("workers", [1, 3])
def test_on_workers_of_dask(workers):
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    scene = Scene(SQUARES, SQUARES_FACES)
    rays = np.random.default_rng(7).random((20_000, 6), np.float32) * 4
    expected = closest(rays, scene)
    with distributed.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            on_workers = client.scatter(scene, broadcast=True)
            parts = [client.submit(closest, part, on_workers) for part in np.array_split(rays, 7)]
            found = client.gather(parts)
    assert tuple(b"".join(parts) for parts in zip(*found)) == expected
