"""`make install`: what is where, manual pages without warnings, completions in real shells."""

from __future__ import annotations

import os
import pty
import re
import select
import shutil
import subprocess
import time
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
PREFIX = "usr/local"


def make(target: str, root: Path) -> None:
    # Variables of the make that started the tests would reach this one.
    environment = {name: value for name, value in os.environ.items() if "MAKE" not in name}
    command: list[str | Path] = ["make", target, f"DESTDIR={root}", f"PREFIX=/{PREFIX}"]
    ran = subprocess.run(
        command, cwd=CHECKOUT, env=environment, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr


def files(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The root below which the checkout is installed."""
    root = tmp_path_factory.mktemp("root")
    make("install", root)
    return root


def test_everything_is_where_users_look(root: Path) -> None:
    share = root / PREFIX / "share"
    scenes = {path.name for path in (CHECKOUT / "configs").glob("*.toml")}
    assert {path.name for path in (share / "gshear-mpi/configs").iterdir()} == scenes
    for scene in (share / "gshear-mpi/configs").iterdir():
        schema = scene.read_text().splitlines()[0].removeprefix("#:schema ")
        assert (scene.parent / schema).resolve() == share / "gshear-mpi/scene.schema.json"
    installed = files(root / PREFIX)
    assert installed >= {
        "bin/gshear-mpi",
        "bin/gshear-reduce",
        "share/bash-completion/completions/gshear-mpi",
        "share/bash-completion/completions/gshear-reduce",
        "share/doc/gshear-mpi/README.md",
        "share/doc/gshear-mpi/docs/README.md",
        "share/doc/gshear-mpi/docs/figures/movie.png",
        "share/fish/vendor_completions.d/gshear-mpi.fish",
        "share/gshear-mpi/job-scripts/slurm.sh",
        "share/man/man1/gshear-mpi.1",
        "share/man/man1/gshear-reduce.1",
        "share/zsh/site-functions/_gshear-mpi",
    }
    scene = share / "gshear-mpi/configs/jamming-2d.toml"
    check: list[str | Path] = [root / PREFIX / "bin/gshear-mpi", scene, "--check"]
    assert subprocess.run(check, capture_output=True, check=False).returncode == 0


def test_uninstall_removes_what_was_installed_and_nothing_else(tmp_path: Path) -> None:
    others = {f"{PREFIX}/bin/gshear", f"{PREFIX}/share/man/man1/gshear.1"}
    for name in others:
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text("")
    make("install", tmp_path)
    assert len(files(tmp_path)) > 100
    make("uninstall", tmp_path)
    assert files(tmp_path) == others


def commands() -> list[str]:
    ran = subprocess.run(
        [os.environ["GSHEAR_REDUCE"], "--help"], capture_output=True, text=True, check=True
    )
    listed = ran.stdout.split("Commands:")[1].split("Options:")[0]
    names = re.findall(r"^  ([a-z-]+)", listed, re.MULTILINE)
    assert len(names) > 10
    return [name for name in names if name != "help"]


def test_every_command_has_a_page_without_warnings(root: Path) -> None:
    folder = root / PREFIX / "share/man/man1"
    pages = sorted(folder.iterdir())
    wanted = {f"gshear-reduce-{name}.1" for name in commands()}
    assert {page.name for page in pages} == wanted | {
        "gshear-mpi.1",
        "gshear-mpi-new.1",
        "gshear-reduce.1",
    }
    ran = subprocess.run(
        ["mandoc", "-T", "lint", "-W", "warning", *pages],  # noqa: S607
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ran.returncode, ran.stdout) == (0, "")


def test_a_page_says_what_help_says(root: Path) -> None:
    page = root / PREFIX / "share/man/man1/gshear-mpi.1"
    command: list[str | Path] = ["mandoc", "-T", "utf8", "-O", "width=1000", page]
    ran = subprocess.run(command, capture_output=True, text=True, check=True)
    shown = re.sub(r".\x08", "", ran.stdout)
    ran = subprocess.run(
        [os.environ["GSHEAR_MPI"], "--help"], capture_output=True, text=True, check=True
    )
    options = re.findall(r"^ +(--[a-z-]+)", ran.stdout, re.MULTILINE)
    assert len(options) > 10
    for option in options:
        assert re.search(rf"^ +{option}\b", shown, re.MULTILINE), option
    assert re.search(r"EXIT STATUS\n +0 +done\n", shown)
    assert re.search(r"\n +75 +stopped early", shown)


class Interactive:
    """An interactive shell with the completions of one program, as a user has it."""

    def __init__(self, command: list[str], folder: Path, begin: list[str]) -> None:
        child, self.terminal = pty.fork()
        if child == 0:
            os.chdir(folder)
            environment = {"PATH": os.environ["PATH"], "TERM": "dumb", "HISTFILE": ""}
            os.execvpe(command[0], command, environment)  # noqa: S606
        for line in [*begin, "stty cols 1000", "echo rea''dy"]:
            self.say(line + "\n")
        self.read_until("ready")

    def say(self, text: str) -> None:
        os.write(self.terminal, text.encode())

    def read_until(self, word: str) -> str:
        text = ""
        end = time.monotonic() + 60
        while not re.search(rf"^{word}\r?$", text, re.MULTILINE):
            readable, _, _ = select.select([self.terminal], [], [], end - time.monotonic())
            assert readable, f"the shell said {text!r}"
            text += os.read(self.terminal, 4096).decode()
        return text

    def complete(self, line: str) -> list[str]:
        """Returns the words that the shell inserts at the end of the line for escape and `*`."""
        # The line becomes arguments of printf.
        self.say(line + "\x1b*\x01printf '<%s>\\n' \x05; echo en''d\n")
        words = re.findall(r"^<(.*)>\r?$", self.read_until("end"), re.MULTILINE)
        given = line.split()
        return words[len(given) if line.endswith(" ") else len(given) - 1 :]


def in_bash(share: Path, folder: Path, line: str) -> list[str]:
    completions = share / "bash-completion/completions" / line.split()[0]
    begin = ["PS1=; bind 'set enable-bracketed-paste off'", f"source '{completions}'"]
    # Escape and * is insert-completions.
    shell = Interactive(["bash", "--norc", "--noprofile", "-i"], folder, begin)
    return shell.complete(line)


def in_zsh(share: Path, folder: Path, line: str) -> list[str]:
    begin = [
        "PS1=; unset zle_bracketed_paste; bindkey -e",
        f"fpath=('{share}/zsh/site-functions' $fpath); autoload -U compinit; compinit -D -u",
        "insert-all() { _main_complete; compstate[insert]=all; compstate[list]= }",
        "zle -C insert-all complete-word insert-all; bindkey '\\e*' insert-all",
    ]
    shell = Interactive(["zsh", "-f", "-i"], folder, begin)
    # A value may follow the name of an option after "=".
    return [word.removesuffix("=") for word in shell.complete(line)]


def in_fish(share: Path, folder: Path, line: str) -> list[str]:
    script = "set -p fish_complete_path $argv[1]; complete --do-complete $argv[2]"
    vendor = share / "fish/vendor_completions.d"
    command: list[str | Path] = ["fish", "--no-config", "-c", script, vendor, line]
    # It knows the completions of programs that are there.
    path = f"{share.parent / 'bin'}:{os.environ['PATH']}"
    environment = {"PATH": path, "HOME": str(folder.parent)}
    ran = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    assert not ran.stderr
    # A word, and behind a tab its description.
    return [word.split("\t")[0] for word in ran.stdout.splitlines()]


SHELLS = {"bash": in_bash, "zsh": in_zsh, "fish": in_fish}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ["configs/a.toml", "configs/b.toml", "out/run.h5", "own.toml"]:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    return tmp_path


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("gshear-mpi ow", ["own.toml"]),
        ("gshear-mpi configs/", ["configs/a.toml", "configs/b.toml"]),
        ("gshear-mpi --out out configs/", ["configs/a.toml", "configs/b.toml"]),
        ("gshear-mpi --s", ["--set", "--sweep", "--stop-at"]),
        ("gshear-mpi own.toml --sweep ", ["list", "status", "all"]),
        ("gshear-mpi ne", ["new"]),
        ("gshear-mpi new walls", ["walls-2d", "walls-3d"]),
        ("gshear-mpi own.toml --sweep l", ["list"]),
        ("gshear-mpi own.toml --resume a", ["auto"]),
        ("gshear-mpi --resume out/", ["out/run.h5"]),
        ("gshear-mpi own.toml --out c", ["configs"]),
        ("gshear-reduce inf", ["info"]),
        ("gshear-reduce re", ["regions", "replay", "report"]),
        ("gshear-reduce info out/", ["out/run.h5"]),
        ("gshear-reduce export out/run.h5 --format v", ["vtkhdf"]),
        (
            "gshear-reduce export out/run.h5 --format l",
            ["lammps-data", "liggghts-data", "lammps-dump"],
        ),
        ("gshear-reduce export --fields ", ["dmin", "stress", "regions", "contacts", "material"]),
        ("gshear-reduce stages out/run.h5 --reduction n", ["net"]),
        ("gshear-reduce rate-state --law b", ["both"]),
        ("gshear-reduce report out/", ["out/run.h5"]),
    ],
)
@pytest.mark.parametrize("shell", SHELLS)
def test_shells_complete(root: Path, folder: Path, shell: str, line: str, words: list[str]) -> None:
    if shutil.which(shell) is None:
        # scripts/release installs them and sets this.
        assert "ALL_SHELLS" not in os.environ, f"no {shell}"
        pytest.skip(f"no {shell}")
    found = SHELLS[shell](root / PREFIX / "share", folder, line)
    assert sorted(word.rstrip("/") for word in found) == sorted(words)
