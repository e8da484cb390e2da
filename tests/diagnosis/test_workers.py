"""Jobs in several processes come back in order, and a process that dies is said."""

import multiprocessing
import os

import pytest

from sysid.diagnosis.workers import WorkerPool
from sysid.errors import SysidError


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_jobs(workers):
    with WorkerPool(workers) as pool:
        assert list(pool.each(pow, [(2, n) for n in range(6)])) == [1, 2, 4, 8, 16, 32]


def test_one_worker_does_no_more_than_is_asked_for():
    done: list[int] = []
    with WorkerPool(1) as pool:
        pool.begin(done.append, 1)
        wanted = pool.begin(done.append, 2)
        assert not done
        wanted()
    assert done == [2]


def test_workers_load_before_there_is_a_job():
    before = len(multiprocessing.active_children())
    with WorkerPool(2):
        assert len(multiprocessing.active_children()) == before + 2


def test_a_worker_computes_in_one_thread_unless_it_is_told_otherwise(monkeypatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    with WorkerPool(2) as pool:
        assert pool.begin(os.getenv, "OPENBLAS_NUM_THREADS")() == "1"
        assert pool.begin(os.getenv, "OMP_NUM_THREADS")() == "3"
    assert "OPENBLAS_NUM_THREADS" not in os.environ


def test_a_process_that_dies_is_said():
    with pytest.raises(SysidError, match="--workers 1"), WorkerPool(2) as pool:
        list(pool.each(os._exit, [(1,)]))


def test_an_error_of_a_job_is_the_error_of_the_pool():
    with pytest.raises(ZeroDivisionError), WorkerPool(2) as pool:
        list(pool.each(divmod, [(1, 0)]))
