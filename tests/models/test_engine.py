"""Jobs: equal results on every engine, only what is missing, failures listed, ends in good order."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fieldmodels.engine import HERE, Engine, Job, JobsFailedError, cluster, done_before, run_all, run_jobs

WORK = """
import os, time
from pathlib import Path
from fieldmodels.engine import stop_between


def square(x, folder, report):
    report("squaring", 0.5)
    (folder / "calls").open("a").write("x")
    (folder / "deep").mkdir(exist_ok=True)
    (folder / "deep" / "bytes").write_bytes(bytes([x]))
    return {"square": x * x / 3}


def plain(x):
    return x / 7, "pair"


def bad(x):
    raise ValueError(f"no {x}")


def deadly(x):
    os.abort()


def slow(seconds, folder, report):
    began = time.monotonic()
    done = int((folder / "checkpoint").read_text()) if (folder / "checkpoint").exists() else 0
    with stop_between() as asked:
        (folder / "pid").write_text(str(os.getpid()))  # from here on a signal is a request
        while time.monotonic() < began + seconds:
            done += 1
            time.sleep(0.02)
            if asked():
                (folder / "checkpoint").write_text(str(done))
                raise KeyboardInterrupt
    return done


def nap(x, folder, report):
    time.sleep(1.0)
    return {"half": x / 2}
"""


@pytest.fixture
def work(tmp_path, monkeypatch):
    """A module that other processes find, too."""
    (tmp_path / "engine_work.py").write_text(WORK)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    import engine_work

    yield engine_work
    del sys.modules["engine_work"]


def squares(work, folder, n=4):
    return [Job(f"key{x}", f"square {x}", work.square, (x,), folder / str(x)) for x in range(n)]


def files(folder):
    """All that jobs leave, but how long they took."""
    found = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        data = path.read_bytes()
        if path.name == "result.json":
            data = json.dumps(json.loads(data) | {"processor_s": 0})
        found[str(path.relative_to(folder))] = data
    return found


def test_processes_give_what_this_process_gives(work, tmp_path):
    here = run_all(squares(work, tmp_path / "here"))
    there = run_all(squares(work, tmp_path / "there"), Engine(workers=2))
    assert (
        [one.result for one in here]
        == [one.result for one in there]
        == [{"square": x * x / 3} for x in range(4)]
    )
    assert files(tmp_path / "here") == files(tmp_path / "there")
    assert "result.json" in {path.name for path in (tmp_path / "there" / "0").iterdir()}


@pytest.mark.parametrize("engine", [HERE, Engine(workers=2)])
def test_only_what_is_missing_runs(engine, work, tmp_path):
    run_all(squares(work, tmp_path, 2), engine)
    seen = []
    again = list(run_jobs(squares(work, tmp_path, 3), engine, lambda stage, part: seen.append((stage, part))))
    assert [one.resumed for one in again] == [True, True, False]
    assert [(tmp_path / str(x) / "calls").read_text() for x in range(3)] == ["x"] * 3
    assert seen[-1] == ("square 2", 1.0)
    stale = [Job("other", "square 0", work.square, (0,), tmp_path / "0")]
    assert [one.resumed for one in run_jobs(stale, engine)] == [False]
    assert (tmp_path / "0" / "calls").read_text() == "xx"


@pytest.mark.parametrize("engine", [HERE, Engine(workers=2)])
def test_failures_are_listed_and_the_others_go_on(engine, work, tmp_path):
    jobs = [
        Job("b", "the bad one", work.bad, (3,)),
        Job("p", "plain", work.plain, (3,)),
        *squares(work, tmp_path),
    ]
    with pytest.raises(
        JobsFailedError, match="1 of 6 jobs failed, the others are kept:\nthe bad one: ValueError: no 3"
    ):
        run_all(jobs, engine)
    assert all((tmp_path / str(x) / "result.json").is_file() for x in range(4))
    assert next(run_jobs(jobs[1:2], engine)).result == (3 / 7, "pair")


def test_a_job_that_kills_its_process_has_failed_and_the_others_go_on(work):
    jobs = [Job(str(i), "", work.deadly if i == 1 else work.plain, (i,)) for i in range(5)]
    done = {one.job: one for one in run_jobs(jobs, Engine(workers=2))}
    assert [done[job].error for job in jobs] == ["", "its process died (SIGABRT)", "", "", ""]


PARENT = """
import sys
from pathlib import Path
import engine_work
from fieldmodels.engine import Engine, Job, run_all
if __name__ == "__main__":
    jobs = [Job(str(i), "slow", engine_work.slow, (60.0,), Path(sys.argv[1]) / str(i)) for i in range(2)]
    run_all(jobs, Engine(workers=2))
"""


def wait_for(found, seconds=60.0):
    end = time.monotonic() + seconds
    while not found():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(") ")[1][0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks Linux which processes live")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_children_end_with_their_parent_and_keep_a_checkpoint(number, work, tmp_path):
    (tmp_path / "parent.py").write_text(PARENT)
    parent = subprocess.Popen(
        [sys.executable, tmp_path / "parent.py", tmp_path], stderr=subprocess.PIPE, text=True
    )
    pids = [tmp_path / str(i) / "pid" for i in range(2)]
    wait_for(lambda: all(pid.is_file() for pid in pids))
    parent.send_signal(number)
    _, said = parent.communicate(timeout=60)
    wait_for(lambda: not any(alive(pid.read_text()) for pid in pids))
    assert all(int((tmp_path / str(i) / "checkpoint").read_text()) > 0 for i in range(2))
    if number == signal.SIGTERM:
        assert parent.returncode != 0
        assert "0 of 2 jobs are done" in said


def test_without_ray_the_message_names_the_extra(monkeypatch, work):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ValueError, match=r"pip install 'fieldgym\[cluster\]'"):
        run_all([Job("p", "", work.plain, (1,))], Engine("ray"))


def test_a_machine_without_the_folder_gets_its_files_and_sends_back_its_own(work, tmp_path):
    (job,) = squares(work, tmp_path / "driver", 1)
    (job.folder / "kept").mkdir(parents=True)
    (job.folder / "calls").write_text("earlier ")
    token, sent = cluster._sent(job, "token")
    (job.folder / cluster.TOKEN).write_text("of another machine")
    done, back = cluster._work(job, cluster._code(job), token, sent)
    assert (done.error, done.result) == ("", {"square": 0.0})
    assert (job.folder / "calls").read_text() == "earlier "  # worked elsewhere
    cluster._unpack(back, job.folder)
    assert (job.folder / "calls").read_text() == "earlier x"
    assert (job.folder / "deep" / "bytes").read_bytes() == bytes([0])
    assert done_before(job).result == {"square": 0.0}
    assert "another version" in cluster._work(job, "other code", token, sent)[0].error


@pytest.mark.nightly
def test_a_cluster_that_loses_a_machine_gives_what_this_process_gives(work, tmp_path):
    """Two machines of Ray in one; one is killed while both work."""
    cluster_utils = pytest.importorskip("ray.cluster_utils")
    import ray

    def naps(folder):
        return [Job(f"key{x}", f"nap {x}", work.nap, (x,), folder / str(x)) for x in range(10)]

    machines = cluster_utils.Cluster(
        initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False}
    )
    try:
        lost = machines.add_node(num_cpus=2)
        ray.init(address=machines.address, log_to_driver=False)
        seen = []
        for done in run_jobs(naps(tmp_path / "ray"), Engine("ray", address=machines.address)):
            seen.append(done)
            if len(seen) == 3:
                machines.remove_node(lost, allow_graceful=False)
        assert not [done.error for done in seen if done.error]
        run_all(naps(tmp_path / "here"))
        assert files(tmp_path / "ray") == files(tmp_path / "here")
        bad = [Job("d", "deadly", work.deadly, (1,)), Job("b", "bad", work.bad, (1,))]
        errors = sorted(one.error for one in run_jobs(bad, Engine("ray")))
        assert errors[0] == "ValueError: no 1"
        assert errors[1].startswith("WorkerCrashedError")
    finally:
        ray.shutdown()
        machines.shutdown()
