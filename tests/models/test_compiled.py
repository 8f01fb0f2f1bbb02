"""Compiled kernels on disk: never stale, never in the way, shared by processes, bounded."""

import dis
import gc
import hashlib
import importlib
import io
import os
import pkgutil
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core import config, event
from numba.core.compiler import Flags
from numba.core.typing.context import Context
from numba.extending import overload

import fieldagents
import fieldmodels
from fieldmodels.compiled import (
    allocation_free,
    allocation_free_inlined,
    cache,
    cache_folder,
    compiled,
    fingerprint,
    folder,
    inlined,
)
from fieldmodels.compiled.fingerprint import globals_read
from fieldmodels.compiled.memoising import _Settled

LAB = {
    "__init__.py": "",
    "numbers.py": "BASE = 2.0\nGAIN = BASE * 5.0\nTABLE = (1.0, 2.0)\n",
    "deep.py": "from fieldmodels.compiled import inlined\n\n@inlined\ndef deep(x):\n    return x + 1.0\n",
    "middle.py": (
        "from fieldmodels.compiled import inlined\nfrom lab import numbers\nfrom lab.deep import deep\n\n"
        "@inlined\ndef middle(x):\n    return numbers.GAIN * deep(x)\n"
    ),
    "kernels.py": (
        "from collections import namedtuple\nfrom fieldmodels.compiled import compiled\n"
        "from lab.middle import middle\nfrom lab.numbers import TABLE\n\n"
        "Pair = namedtuple('Pair', ['first', 'second'])\n\n"
        "@compiled\ndef reaches(x):\n    return middle(x) + TABLE[0]\n\n"
        "@compiled\ndef alone(x):\n    return 3.0 * x\n\n"
        "@compiled\ndef first(pair):\n    return pair.first\n"
    ),
}
REPORT = """
import sys, warnings
with warnings.catch_warnings(record=True) as heard:
    warnings.simplefilter("always")
    from lab import kernels
    for name in sys.argv[1:]:
        kernel = getattr(kernels, name)
        argument = kernels.Pair(second=7.0, first=5.0) if name == "first" else 1.0
        print(name, kernel(argument), "hit" if sum(kernel.stats.cache_hits.values()) else "miss")
for warning in heard:
    print("warning", warning.message)
"""
LIST = "import sys; from fieldagents.cli import main; sys.argv = ['fieldgym', 'list']; main()"


class Lab:
    """A small package of kernels, and a cache of its own, each used by new processes."""

    def __init__(self, root: Path):
        self.root, self.package, self.home = root, root / "lab", root / "cache"
        self.prelude = ""
        self.package.mkdir()
        for name, text in LAB.items():
            (self.package / name).write_text(text)
        floor = Path(fieldmodels.__file__).parents[1]
        self.environment = {
            **{k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")},
            "PYTHONPATH": os.pathsep.join([str(root), str(floor), os.environ.get("PYTHONPATH", "")]),
            "XDG_CACHE_HOME": str(self.home),
            "PYTHONDONTWRITEBYTECODE": "1",
        }

    @property
    def files(self) -> list[Path]:
        return sorted((self.home / "fieldgym" / "kernels").glob("lab.*"))

    def edit(self, name: str, old: str, new: str) -> None:
        path = self.package / name
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))

    def start(self, *names: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", self.prelude + REPORT, *names]
        return subprocess.Popen(command, env=self.environment, text=True, stdout=-1, stderr=-1)

    def finish(self, process: subprocess.Popen[str]) -> list[str]:
        out, err = process.communicate(timeout=120)
        assert process.returncode == 0, err
        return out.splitlines()

    def run(self, *names: str) -> list[str]:
        return self.finish(self.start(*names))


@pytest.fixture
def lab(tmp_path: Path) -> Lab:
    return Lab(tmp_path)


@pytest.mark.nightly
def test_an_edit_recompiles_exactly_what_it_reaches(lab):
    assert lab.run("reaches", "alone") == ["reaches 21.0 miss", "alone 3.0 miss"]
    assert lab.run("reaches", "alone") == ["reaches 21.0 hit", "alone 3.0 hit"]
    lab.edit("deep.py", "x + 1.0", "x + 2.0")  # a helper of a helper, two files away
    assert lab.run("reaches", "alone") == ["reaches 31.0 miss", "alone 3.0 hit"]
    lab.edit("numbers.py", "BASE = 2.0", "BASE = 4.0")  # a constant from which another is computed
    assert lab.run("reaches", "alone") == ["reaches 61.0 miss", "alone 3.0 hit"]
    lab.edit("numbers.py", "TABLE = (1.0", "TABLE = (9.0")
    assert lab.run("reaches") == ["reaches 69.0 miss"]


def test_what_changes_no_result_recompiles_nothing(lab):
    lab.run("reaches")
    os.utime(lab.package / "deep.py", (1.0, 1.0))
    lab.edit("deep.py", "    return", '    """What it does."""\n    # Why.\n\n    return')
    assert lab.run("reaches") == ["reaches 21.0 hit"]


def test_exchanged_fields_of_an_argument_are_noticed(lab):
    assert lab.run("first") == ["first 5.0 miss"]
    lab.edit("kernels.py", "['first', 'second']", "['second', 'first']")
    assert lab.run("first") == ["first 5.0 miss"]


def test_a_helper_may_move_to_another_file(lab):
    lab.run("reaches")
    (lab.package / "deep.py").rename(lab.package / "deeper.py")
    lab.edit("middle.py", "lab.deep", "lab.deeper")
    assert lab.run("reaches") == ["reaches 21.0 miss"]


@pytest.mark.matrix(keep=("bit",))
@pytest.mark.parametrize("spoil", ["empty", "cut", "bit", "foreign"])
def test_a_spoilt_file_is_compiled_anew(lab, spoil):
    lab.run("reaches")
    path = next(path for path in lab.files if ".reaches-" in path.name)
    content = path.read_bytes()
    foreign = b"cno_such_package\nThing\n."  # a pickle that is whole but wants a module that is gone
    path.write_bytes(
        {
            "empty": b"",
            "cut": content[: len(content) // 2],
            "bit": content[:-100] + bytes([content[-100] ^ 1]) + content[-99:],
            "foreign": hashlib.sha256(foreign).digest() + foreign,
        }[spoil]
    )
    assert lab.run("reaches") == ["reaches 21.0 miss"]
    assert lab.run("reaches") == ["reaches 21.0 hit"]


def test_nothing_is_written_beside_the_source(lab):
    before = sorted(lab.package.rglob("*"))
    lab.run("reaches", "alone")
    assert sorted(lab.package.rglob("*")) == before
    assert lab.files


def test_processes_that_compile_at_once_agree(lab):
    names = ("reaches", "alone", "first")
    values = ["reaches 21.0", "alone 3.0", "first 5.0"]
    for process in [lab.start(*names) for _ in range(4)]:
        assert [line.rpartition(" ")[0] for line in lab.finish(process)] == values
    assert lab.run(*names) == [f"{value} hit" for value in values]
    assert not list((lab.home / "fieldgym" / "kernels").glob("*.tmp"))


def blocked(lab: Lab) -> None:
    """Files stand where the folders should be: that binds even root, whom no permission stops."""
    lab.home.write_text("no folder")
    temporary = lab.root / "temporary"
    temporary.mkdir()
    (temporary / f"fieldgym-{os.getuid()}").write_text("no folder")
    lab.environment["TMPDIR"] = str(temporary)


def test_without_any_folder_it_compiles_with_one_warning(lab):
    blocked(lab)
    *results, warning = lab.run("reaches", "alone")
    assert results == ["reaches 21.0 miss", "alone 3.0 miss"]
    assert warning.startswith("warning no folder can be written to keep compiled kernels")
    assert "NUMBA_CACHE_DIR" in warning


def test_the_command_line_lists_where_nothing_can_be_written(lab):
    blocked(lab)
    command = [sys.executable, "-W", "error::RuntimeWarning", "-c", LIST]
    done = subprocess.run(command, env=lab.environment, text=True, capture_output=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "excitation" in done.stdout


def test_an_unwritable_user_cache_gives_way_to_a_private_temporary_folder(lab):
    blocked(lab)
    private = lab.root / "temporary" / f"fieldgym-{os.getuid()}"
    private.unlink()
    assert lab.run("alone") == ["alone 3.0 miss"]
    assert lab.run("alone") == ["alone 3.0 hit"]
    assert private.stat().st_mode & 0o777 == 0o700
    shutil.rmtree(private)
    private.mkdir()
    private.chmod(0o777)  # anybody could plant a kernel here, and loading one executes it
    assert lab.run("alone")[-1].startswith("warning no folder")
    assert not list(private.iterdir())


def test_a_warm_folder_that_cannot_be_written_still_serves(lab):
    lab.run("alone")
    lab.prelude = "import fieldmodels.compiled.folder as folder; folder._writable = lambda _: False\n"
    assert lab.run("alone") == ["alone 3.0 hit"]
    assert lab.run("reaches")[-1].startswith("warning no folder")


@pytest.mark.nightly
def test_old_versions_do_not_pile_up(lab):
    lab.run("reaches", "alone")
    (alone,) = (path for path in lab.files if ".alone-" in path.name)
    forgotten = alone.with_name(f"lab.renamed-0-0{cache.SUFFIX}")
    forgotten.write_bytes(b"")
    os.utime(forgotten, (1e9, 1e9))
    for number in range(cache.VERSIONS + 2):
        lab.edit("deep.py", f"x + {number + 1}.0", f"x + {number + 2}.0")
        assert lab.run("reaches") == [f"reaches {10.0 * (number + 3) + 1.0} miss"]
    assert sum(".reaches-" in path.name for path in lab.files) == cache.VERSIONS
    assert alone in lab.files
    assert not forgotten.exists()
    lab.edit("deep.py", f"x + {number + 2}.0", f"x + {number + 1}.0")  # back to the version before
    assert lab.run("reaches") == [f"reaches {10.0 * (number + 2) + 1.0} hit"]


def test_all_kernels_together_have_a_largest_size(tmp_path, monkeypatch):
    for age in range(6):
        path = tmp_path / f"lab.kernel{age}-0-0{cache.SUFFIX}"
        path.write_bytes(bytes(1000))
        os.utime(path, (time.time() - 60 * age,) * 2)
    monkeypatch.setattr(cache, "MOST_BYTES", 3500)
    cache._remove_unused(tmp_path)
    assert sorted(path.name[10] for path in tmp_path.iterdir()) == ["0", "1", "2"]  # those used last


@pytest.fixture
def fresh_folder():
    cache_folder.cache_clear()
    yield
    cache_folder.cache_clear()


def test_the_folder_is_named_by_the_user(tmp_path, monkeypatch, fresh_folder):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    monkeypatch.setattr(config, "CACHE_DIR", "")
    assert cache_folder() == tmp_path / "user" / "fieldgym" / "kernels"
    cache_folder.cache_clear()
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "numba"))
    assert cache_folder() == tmp_path / "numba" / "fieldgym"


def test_no_home_no_temporary_folder_no_cache(tmp_path, monkeypatch, fresh_folder):
    monkeypatch.setattr(config, "CACHE_DIR", "")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)

    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", homeless)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    assert cache_folder() is None


def kernels_of(package):
    for found in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not found.name.endswith("__main__"):
            module = importlib.import_module(found.name)
            for name, value in vars(module).items():
                if hasattr(value, "py_func") and value.py_func.__module__ == module.__name__:
                    yield f"{module.__name__}.{name}", value


def test_every_kernel_of_the_project_has_a_fingerprint_of_its_own():
    found = dict(kernels_of(fieldmodels))
    found.update(kernels_of(fieldagents))
    assert len(found) > 150
    assert all(type(kernel._cache) is cache.KernelCache for kernel in found.values())
    assert len({fingerprint(kernel) for kernel in found.values()}) == len(found)


def test_the_globals_that_a_kernel_reads_are_those_of_the_disassembler():
    def told(code):
        yield from (i.argval for i in dis.get_instructions(code) if i.opname == "LOAD_GLOBAL")
        for constant in code.co_consts:
            if hasattr(constant, "co_code"):
                yield from told(constant)

    # Some of them with hundreds of names, and one with a function inside.
    codes = [kernel.py_func.__code__ for _, kernel in kernels_of(fieldmodels)]
    codes += [fieldmodels.compiled.fingerprint.__code__, told.__code__, Lab.finish.__code__]
    for code in codes:
        assert globals_read(code) == frozenset(told(code))


def test_closures_defaults_options_and_libraries_are_told_apart():
    def make(value, power=2.0, **options):
        def own(x, y=value):
            return x * y**power

        return numba.njit(**options)(own)

    def calls(function):
        return compiled(lambda x: function(x))

    assert fingerprint(make(1.0)) == fingerprint(make(1.0))
    kinds = [make(1.0), make(2.0), make(1.0, power=3.0), make(1.0, fastmath=True), make(True)]
    assert len({fingerprint(kind) for kind in kinds}) == len(kinds)
    assert len({fingerprint(calls(kind)) for kind in kinds}) == len(kinds)


def test_recursion_has_a_fingerprint():
    @compiled
    def countdown(n):
        if n <= 0:
            return 0
        return countdown(n - 1)

    assert len(fingerprint(countdown)) == 64
    assert countdown(3) == 0


def test_an_unknown_constant_is_named_and_not_cached(tmp_path, monkeypatch, fresh_folder):
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))

    class Odd:
        """Numba could not read it anyway; a later Numba may."""

    odd = Odd()

    def reads():
        return odd

    with pytest.raises(TypeError, match=r"Odd.*no fingerprint"):
        fingerprint(reads)


class Terminal(io.StringIO):
    """Standard error of somebody who looks on."""

    def isatty(self):
        return True


def test_a_terminal_is_told_what_is_being_compiled_until_it_is(tmp_path, monkeypatch, fresh_folder):
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)

    def told(step):
        @compiled
        def ahead(x):
            return x + step

        ahead(1.0)
        lines, _ = shown.getvalue().split("\r\x1b[K")[1:], shown.truncate(shown.seek(0))
        return lines

    @compiled
    def impossible(x):
        return x.nothing_of_the_kind

    with pytest.raises(numba.TypingError):
        impossible(1.0)
    assert shown.getvalue().endswith("\r\x1b[K")  # no longer under way
    shown.truncate(shown.seek(0))
    first = told(2.0)
    assert "ahead" in first[0]
    assert first[-1] == ""
    assert told(2.0) == []  # from the disk


def test_a_log_has_one_line_about_what_is_compiled_and_none_once_it_is(lab):
    def said(code):
        command = [sys.executable, "-c", f"import multiprocessing\nfrom lab import kernels\n{code}"]
        return subprocess.run(command, env=lab.environment, text=True, capture_output=True, check=True).stderr

    work = "def work(x): return kernels.alone(x)\n"  # a kernel itself would be sent without its cache
    worker = "with multiprocessing.get_context('fork').Pool(1) as pool: pool.map(work, [1.0])"
    assert said(work + worker) == ""  # its parent says it
    assert lab.files
    lab.edit("kernels.py", "3.0 * x", "4.0 * x")
    both = "kernels.alone(1.0), kernels.reaches(1.0)"
    (line,) = said(both).splitlines()
    assert line.startswith("fieldgym: compiling, once on this machine: lab.kernels.alone")
    assert said(both) == ""


def test_a_folder_refused_for_its_owner(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(os, "getuid", lambda: 12345)  # the folder will be of another owner
    assert folder._private_temporary() is None


def test_what_counts_no_references_may_hand_out_no_array():
    @allocation_free
    def first(x):
        return x[0]

    @allocation_free
    def same(x):
        return 1.0, x

    assert first(np.array([3.0])) == 3.0
    with pytest.raises(TypeError, match="returns an array"):
        same(np.array([3.0]))


def test_a_part_of_what_counts_no_references_may_hand_out_no_array_either():
    """Else a kernel that counts, and calls the same part later, would use memory that is already freed."""

    @inlined
    def same(x):
        return x

    @inlined
    def double(x):
        return 2.0 * x[0]

    @allocation_free_inlined
    def itself(x):
        return x

    @allocation_free
    def first(x):
        return same(x)[0]

    @allocation_free
    def doubled(x):
        return double(x)

    @compiled
    def created():
        return itself(np.ones(3))

    for kernel, arguments in ((first, [np.ones(3)]), (created, [])):
        kernel._cache.disable()
        with pytest.raises(TypeError, match="returns an array"):
            kernel(*arguments)
    assert doubled(np.ones(3)) == 2.0


@inlined
def third(values, place):
    if place > 2:
        raise ValueError("there is no third of", place)
    return values[place] / 3.0


@compiled
def thirds(values):
    return third(values, 0) + third(values, 1) + third(values, len(values) - 1)


def test_a_part_has_one_version_no_file_and_its_own_errors(tmp_path, monkeypatch, fresh_folder):
    """One version for all constants, none of it machine code; what it raises reaches who called the whole."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    compiling = []
    with event.install_recorder("numba:compile") as record:
        assert thirds(np.ones(3)) == 1.0
    compiling = [one.data["dispatcher"].py_func.__name__ for _, one in record.buffer if one.is_start]
    assert sorted(compiling) == ["third", "thirds"]
    assert [path.name.split("-")[0].rpartition(".")[2] for path in cache_folder().glob("*.kernel")] == [
        "thirds"
    ]
    with pytest.raises(ValueError, match=r"there is no third of") as raised:
        thirds(np.ones(5))
    assert raised.value.args[1] == 4
    assert third(np.ones(3), 1) == 1.0 / 3.0  # Python may call it, too


def test_settings_are_read_a_few_times_a_kernel(monkeypatch):
    """Not for each operator and each of its implementations; and they mean what Numba's own mean."""
    reads = 0

    def counted(flags):
        nonlocal reads
        reads += 1
        return read(flags)

    read = Flags.values
    monkeypatch.setattr(Flags, "values", counted)

    @compiled
    def total(x):
        return x[0] + x[1] + x[2] + x[3]

    total._cache.disable()
    assert total(np.arange(4.0)) == 6.0
    assert reads <= 10
    flags, other = Flags(), Flags()
    other.nrt = True
    assert _Settled(flags) == flags
    assert hash(_Settled(flags)) == hash(flags)
    assert _Settled(flags) != _Settled(other)


def test_an_expression_of_arrays_compiles_in_a_kernel_that_python_calls():
    """Numba compiles it as a part, by settings of its own: the kernel's stay as they are."""

    settled = _Settled(Flags())
    settled.copy().no_cpython_wrapper = True
    assert not settled.no_cpython_wrapper

    @compiled
    def shifted(x):
        return np.asarray(x[0] + 2.0 * x)

    shifted._cache.disable()  # as on a new machine
    assert shifted(np.array([1.0, 2.0])).tolist() == [3.0, 5.0]


def test_what_an_operator_makes_of_numbers_is_found_out_once(monkeypatch):
    """Once a kind of numbers, not once a place; and what is declared later counts."""
    tried = []
    resolve = Context.resolve_function_type

    def counted(self, func, args, kws):
        tried.append((func, args))
        return resolve(self, func, args, kws)

    monkeypatch.setattr(Context, "resolve_function_type", counted)

    @compiled
    def product(x, y, n):
        return x * y * x * y, n * n * n

    product._cache.disable()
    reals, integers = product(1.5, 2.0, 3)
    assert (reals, integers) == (9.0, 27)
    assert isinstance(integers, int)
    assert len(tried) == len(set(tried))

    def named(x):
        raise NotImplementedError

    @compiled
    def of_a_number(x):
        return named(x)

    @compiled
    def of_an_array(x):
        return named(x)

    @overload(named)
    def _named(x):
        return (lambda x: 2.0 * x) if isinstance(x, numba.types.Float) else None

    assert of_a_number(1.5) == 3.0
    with pytest.raises(numba.TypingError):
        of_a_number(np.ones(2))

    @overload(named)
    def _named_array(x):
        return (lambda x: x[0]) if isinstance(x, numba.types.Array) else None

    assert of_an_array(np.ones(2)) == 1.0


def test_a_compilation_starts_no_collection_of_garbage():
    """What it made waits for a full collection; what a program has frozen stays frozen."""
    collected = []

    def count(phase, info):
        if phase == "stop":
            collected.append(info["collected"])

    @compiled
    def sine(x):
        return np.sin(x) + 1.0

    @compiled
    def cosine(x):
        return np.cos(x) + 1.0

    sine._cache.disable()
    cosine._cache.disable()
    gc.collect()
    gc.callbacks.append(count)
    try:
        assert sine(0.0) == 1.0
    finally:
        gc.callbacks.remove(count)
    assert sum(collected) < 100
    assert gc.collect() > 1000
    gc.freeze()
    try:
        frozen = gc.get_freeze_count()
        assert cosine(0.0) == 2.0
        assert gc.get_freeze_count() >= 0.99 * frozen
    finally:
        gc.unfreeze()


def test_garbage_is_collected_again_after_a_failure():
    @compiled
    def wrong(x):
        return x + "one"

    assert gc.isenabled()
    with pytest.raises(numba.TypingError):
        wrong(1.0)
    assert gc.isenabled()
