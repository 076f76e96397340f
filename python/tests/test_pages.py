"""Every command, option and key that a page names exists and does what it says.

Blocks of commands are read line by line. `gshear-mpi` checks its scene (`--check`, or `--sweep
list`), `gshear-reduce` runs on a small run or, with files that only a long run has, reads its
options. Commands of other programs are in `OTHERS`, each with the reason why a test does not run
it. The pages of the tutorial are run as they are (`test_tutorial`).
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from gshear import analysis, programs

CHECKOUT = Path(__file__).resolve().parents[2]
DOCS = CHECKOUT / "docs"
PAGES = sorted(
    [CHECKOUT / "README.md", CHECKOUT / "CONTRIBUTING.md", CHECKOUT / "python/README.md"]
    + [page for page in DOCS.rglob("*.md") if page.parent.name != "tutorial"]
)

# Why a test does not run a program. Of those of this checkout it is seen that they are there.
OTHERS = {
    **dict.fromkeys(["pip", "python3", ".", "export", "cd", "cp", "mkdir"], "of the shell"),
    **dict.fromkeys(["for", "do", "done", "if", "fi", "while", "echo"], "of the shell"),
    **dict.fromkeys(["sbatch", "qsub", "bsub", "srun", "flux", "salloc"], "needs a cluster"),
    **dict.fromkeys(["module", "spack", "rattler-build"], "installs on a cluster"),
    **dict.fromkeys(["docker", "apptainer", "buildah"], "needs containers"),
    **dict.fromkeys(["cargo", "make", "sudo", "git"], "builds; make's targets are checked"),
    "mpirun.mpich": "needs MPICH",
}
# Words that stand for something, and what a test takes.
STANDS_FOR = {
    "RUN": "out/my",
    "RUN1": "out/my",
    "RUN2": "out/my",
    "RUN.h5": "out/my/run.h5",
    "DIR": "results",
    "FOLDER": "results",
    "N": "1",
    "K": "1",
    "F": "0.1",
    "GAMMA": "0.05",
    "RE[,IM": "1e-3",
    "A..B[:N": "1..3",
}
# Reductions that take long, or need what a small run of sheared disks does not have.
PARSED = {"replay", "movie", "watch", "spectrum", "rate-state"}
# Options of other programs: of mpirun and srun, cargo, pip, Docker, Slurm, and so on.
FOREIGN = {
    *("--bind-to", "--mpi", "--release", "--locked", "--test", "--lib", "--bins", "--workspace"),
    *("--nocapture", "--target-dir", "--features", "--bench", "--no-deps", "--all-targets"),
    *("--volume", "--user", "--rm", "--file", "--build-arg", "--tag", "--prefix", "--output"),
    *("--array", "--nodes", "--ntasks", "--ntasks-per-node", "--cpus-per-task", "--time"),
    *("--requeue", "--signal", "--dependency", "--exclusive", "--begin", "--constraint"),
    *("--recipe", "--variant-config", "--strict", "--bindings", "--oversubscribe", "--open"),
    *("--ignored", "--exact", "--dry-run", "--cpu-bind", "--map-by", "--use-hwthread-cpus"),
    *("--add-architecture", "--not-buildable", "--strip-components", "--me"),
    *("--host", "--hostfile", "--timeout", "--allow-run-as-root", "--init", "--shm-size"),
}


class Command(NamedTuple):
    """A line of a block."""

    page: Path
    words: list[str]

    def __str__(self) -> str:
        return f"{self.page.relative_to(CHECKOUT)}: {shlex.join(self.words)}"


def blocks(text: str) -> Iterator[str]:
    """Yields the blocks of `sh`, and those that are indented."""
    yield from re.findall(r"^```sh\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    unfenced = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    yield from re.findall(r"(?<=\n\n)((?: {4}.*\n|\n(?= {4}))+)", unfenced)


def lines(block: str) -> list[str]:
    """Returns the lines of a block without comments; one goes on in the next by `\\` or quotes."""
    text = re.sub(r"\s+#\s.*$", "", block, flags=re.MULTILINE)
    text = re.sub(r"\\\n\s*", " ", text)
    found: list[str] = []
    for line in text.splitlines():
        is_open = bool(found) and found[-1].count("'") % 2 == 1
        found[-1:] = [f"{found[-1]} {line.strip()}"] if is_open else [*found[-1:], line.strip()]
    return found


@cache
def commands() -> list[Command]:
    """Returns the commands of all pages that begin with the name of a program."""
    found = []
    for page in PAGES:
        for block in blocks(page.read_text(encoding="utf-8")):
            variables: dict[str, str] = {}
            for line in lines(block):
                text = line.removeprefix("$ ")
                # Those of a loop have any value.
                text = re.sub(r"\$(\w+)", lambda of: variables.get(of[1], "1"), text)  # noqa: B023
                try:
                    words = shlex.split(text)
                except ValueError:
                    continue
                for part in parts(words):
                    given = [re.fullmatch(r"(\w+)=(.*)", word) for word in part]
                    variables |= {of[1]: of[2] for of in given if of}
                    while part and re.fullmatch(r"\w+=.*", part[0]):
                        part = part[1:]
                    if part and program(part):
                        found.append(Command(page, part))
    return found


def parts(words: list[str]) -> Iterator[list[str]]:
    """Yields the commands of a line with `;` and `&&`, each up to where its output goes."""
    part: list[str] = []
    for word in [*words, ";"]:
        if word.endswith(";") or word == "&&":
            part += [word[:-1]] if len(word) > 1 and word != "&&" else []
            yield part[: part.index(">")] if ">" in part else part
            part = []
        else:
            part.append(word)


def program(words: list[str]) -> str:
    """Returns the program that is meant to run, if the words are a command."""
    if Path(words[0]).name in ("mpirun", "mpiexec") and len(words) > 3:
        return program(words[3:])
    name = Path(words[0]).name
    if name in ("gshear-mpi", "gshear-reduce"):
        return name
    own = ("scripts/", "benches/", "examples/", "target/")
    is_known = words[0] in OTHERS and len(words) > 1 and "=" not in words[1]
    return words[0] if is_known or words[0].startswith(own) or name == "python" else ""


@cache
def help_of(*words: str) -> str:
    """Returns what a program of this checkout says of its options."""
    command = [str(programs.find(words[0])), *words[1:], "--help"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@cache
def reducers() -> list[str]:
    """Returns the commands of gshear-reduce."""
    listed = help_of("gshear-reduce").split("Commands:\n")[1].split("\n\n")[0]
    return [line.split()[0] for line in listed.splitlines() if re.match(r"  \w", line)]


@cache
def schema() -> dict[str, dict[str, object]]:
    """Returns the keys by their tables; those above all tables are of ''."""
    properties = json.loads((DOCS / "scene.schema.json").read_text())["properties"]
    keys = {
        name: table["properties"] for name, table in properties.items() if "properties" in table
    }
    return keys | {"": properties}


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Returns a folder like a checkout, with a scene and a sweep."""
    folder = tmp_path / "checkout"
    folder.mkdir()
    for name in ("configs", "scripts", "examples", "benches", "job-scripts"):
        (folder / name).symlink_to(CHECKOUT / name)
    scene = (CHECKOUT / "tests/scenes/crossing.toml").read_text()
    (folder / "my.toml").write_text(scene)
    (folder / "sweep.toml").write_text(f"{scene}\n[sweep]\nseed = [5, 6]\n")
    return folder


@pytest.fixture
def results(originals: Callable[[str], Path], checkout: Path) -> Path:
    """Returns such a folder with runs."""
    for name in ("my", "first", "a", "sweep/seed-5"):
        shutil.copytree(originals("disks"), checkout / "out" / name)
    for name in ("b", "sweep/seed-6"):
        shutil.copytree(originals("other disks"), checkout / "out" / name)
    shutil.copytree(originals("scalars"), checkout / "out/c")
    return checkout


def run(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    command = [str(programs.find(words[0])), *words[1:]]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def substituted(words: list[str]) -> list[str]:
    """Returns the words of a command with values for what stands for some."""
    plain = [
        word.strip("[]") if word.startswith("[") or word.endswith("]]") else word
        for word in words
        if word not in ("…", "...")
    ]
    return [STANDS_FOR.get(word, word) for word in plain]


def test_simulations_of_pages_pass_their_check(checkout: Path) -> None:
    checked, faults = 0, []
    for command in commands():
        words = command.words
        if Path(words[0]).name in ("mpirun", "mpiexec"):
            words = words[3:]
        if Path(words[0]).name != "gshear-mpi" or "--version" in words:
            continue
        words = ["gshear-mpi", *substituted(words[1:])]
        scene = next((word for word in words[1:] if word.endswith(".toml")), None)
        begins = "--resume" not in words or words[words.index("--resume") + 1] == "auto"
        there = scene is None or (checkout / scene).exists()
        # What a long run has made is not there.
        whole = not any("…" in word or ".data" in word for word in words)
        if begins and there and whole and words[1:2] != ["new"]:
            runs = words[words.index("--sweep") + 1] if "--sweep" in words else ""
            if runs:
                # The sweep of the test has two runs; those at a time cannot be checked.
                words[words.index("--sweep") + 1] = "list" if runs in ("all", "list") else "1"
                for option in {"--jobs", "--ranks"} & set(words):
                    del words[words.index(option) : words.index(option) + 2]
            if runs not in ("all", "list") and "--check" not in words:
                words.append("--check")
            words = [word for word in words if word != "--resume" and word != "auto"]
            said = run([*words, "--quiet"], checkout)
        else:
            said = run([*words, "--help"], checkout)
        checked += 1
        if said.returncode:
            faults.append(f"{command}: exit code {said.returncode}\n{said.stderr}")
        keys = [word.split("=")[0] for word in words if re.match(r"[a-z_]+\.[a-z_]+=", word)]
        faults += [f"{command}: no key {key}" for key in keys if not is_key(key)]
    assert not faults, "\n".join(faults)
    assert checked > 30


def test_reductions_of_pages_do_what_they_say(results: Path) -> None:
    parsed, ran, faults = 0, 0, []
    for command in commands():
        if command.words[0] != "gshear-reduce":
            continue
        for words in alternatives(command.words[1:]):
            words = substituted(words)
            paths = [word for word in words[1:] if "/" in word and "=" not in word]
            there = bool(paths) and (results / paths[0]).exists()
            # The key of --against is not one in which these runs differ.
            can_run = there and words[0] not in PARSED and "--against" not in words
            said = run(["gshear-reduce", *words, *([] if can_run else ["--help"])], results)
            parsed, ran = parsed + 1, ran + can_run
            # Runs that are compared differ.
            if said.returncode > (words[0] == "compare"):
                faults.append(f"{command}: exit code {said.returncode}\n{said.stderr}")
    assert not faults, "\n".join(faults)
    assert parsed > 15
    assert ran > 5


def alternatives(words: list[str]) -> list[list[str]]:
    """Returns a command with each of the values that `a|b` stands for, without brackets."""
    plain = [word.strip("[]") for word in words if word not in ("…", "...", "[RUN")]
    if "|" in words:
        # Two ways to go on from the first words.
        at = words.index("|")
        return [*alternatives(words[:at]), *alternatives([words[0], *words[at + 1 :]])]
    for n, word in enumerate(plain):
        if "|" in word:
            ways = [[*plain[:n], way.strip("[]"), *plain[n + 1 :]] for way in word.split("|")]
            return [found for way in ways for found in alternatives(way)]
    return [plain]


def test_other_programs_of_pages_are_there() -> None:
    makefile = (CHECKOUT / "Makefile").read_text()
    faults = []
    for command in commands():
        words = command.words
        if words[0] == "sudo":
            words = words[1:]
        if words[0] == "make":
            goals = [word for word in words[1:] if "=" not in word and not word.startswith("-")]
            faults += [f"{command}: no target {g}" for g in goals if f"\n{g}:" not in makefile]
        own = [w for w in words if re.match(r"(scripts|benches|examples|configs|packaging)/", w)]
        faults += [f"{command}: no {path}" for path in own if not (CHECKOUT / path).exists()]
        for path in own[:1]:
            if (CHECKOUT / path).suffix == ".py":
                text = (CHECKOUT / path).read_text()
                options = [word.split("=")[0] for word in words if word.startswith("--")]
                faults += [f"{command}: no {o}" for o in options if f'"{o}"' not in text]
    assert not faults, "\n".join(faults)


def is_key(path: str) -> bool:
    table, _, name = path.rpartition(".")
    return name in schema().get(table, {})


def test_options_of_pages_exist() -> None:
    texts = [help_of("gshear-mpi"), help_of("gshear-reduce")]
    texts += [help_of("gshear-reduce", name) for name in reducers() if name != "help"]
    for folder in ("scripts", "benches", "examples", "job-scripts", "packaging", "python/src"):
        texts += [
            path.read_text(errors="replace")
            for path in (CHECKOUT / folder).rglob("*")
            if path.is_file() and path.suffix in ("", ".py", ".sh", ".rs", ".toml")
        ]
    texts += [(CHECKOUT / name).read_text() for name in ("Makefile", "tests/all/main.rs")]
    known = set(re.findall(r"--[a-z][a-z-]*", "\n".join(texts))) | FOREIGN
    faults = [
        f"{page.relative_to(CHECKOUT)}: {option}"
        for page in [*PAGES, *(DOCS / "tutorial").glob("*.md")]
        for option in sorted(set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", page.read_text())))
        if option not in known
    ]
    assert not faults, "\n".join(faults)


def test_keys_of_pages_exist() -> None:
    faults, seen = [], 0
    for page in [*PAGES, *(DOCS / "tutorial").glob("*.md")]:
        for span in re.findall(r"`([^`\n]+)`", page.read_text()):
            key = re.match(r"([a-z]+\.[a-z_]+)(?![\w.(])", span)
            if (
                key is None
                or key[1].split(".")[0] not in schema()
                or " " in span.split("=")[0].strip()
            ):
                continue
            # Names of files.
            if re.search(r"\.(h5|csv|json|toml|data|py|png|svg|md|npz|jsonl|rs)$", key[1]):
                continue
            # The functions of gshear.analysis have the name of a table.
            table, name = key[1].split(".")
            if table == "analysis" and hasattr(analysis, name):
                continue
            seen += 1
            if not is_key(key[1]):
                faults.append(f"{page.relative_to(CHECKOUT)}: `{span}`: no key {key[1]}")
    assert not faults, "\n".join(faults)
    assert seen > 200


def test_ci_runs_the_commands_of_the_readme_in_its_order() -> None:
    readme = (CHECKOUT / "README.md").read_text()
    block = readme.split("**From a checkout**")[1].split("\n\n")[1]
    goals = re.findall(r"^ {4}make (\w+)", block, re.MULTILINE)
    parts = re.findall(r"^part (\w+)$", (CHECKOUT / ".ci/run").read_text(), re.MULTILINE)
    assert goals == ["run", "test"]
    assert parts[: len(goals)] == goals
