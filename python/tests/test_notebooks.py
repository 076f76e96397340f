"""The notebooks: executed with small runs; stored as executed."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nbclient
import nbformat
import pytest

from gshear import Run

from .conftest import SCENES

NOTEBOOKS = Path(__file__).resolve().parents[1] / "notebooks"


def execute(name: str, scene: Path, out: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Executes a notebook, which raises if a cell does, and returns the text of its outputs."""
    monkeypatch.setenv("GSHEAR_NOTEBOOK_SCENE", str(scene))
    monkeypatch.setenv("GSHEAR_NOTEBOOK_OUT", str(out))
    notebook = nbformat.read(NOTEBOOKS / name, as_version=4)
    client = nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3")
    client.execute(cwd=str(NOTEBOOKS))
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    errors = [output for output in outputs if output.get("name") == "stderr"]
    assert errors == []
    data = [output.get("data", {}) for output in outputs]
    assert sum("image/png" in item for item in data) >= 4
    shown = [item.get("text/plain", "") for item in data]
    return "\n".join(shown + [output.get("text", "") for output in outputs])


def test_stick_slip_runs_the_program(
    originals: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The checked scene of a run is a scene.
    scene = originals("disks") / "scene.toml"
    said = execute("stick-slip-2d.ipynb", scene, tmp_path / "out", monkeypatch)
    with Run(tmp_path / "out") as run, Run(originals("disks")) as original:
        assert run.parameters["digest"] == original.parameters["digest"]
        assert f"contacts of a free grain {run.series['coordination'].iloc[0]:.1f}"[:-3] in said


@pytest.mark.parametrize(
    ("name", "words"), [("spheres", ["mu_ss", "healing"]), ("velocity steps", ["mu_ss", "direct"])]
)
def test_gouge_reads_a_run(
    name: str, words: list[str], copy: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = copy(name)
    written = (folder / "run.h5").stat().st_mtime_ns
    said = execute("gouge.ipynb", folder / "scene.toml", folder, monkeypatch)
    assert [word for word in words if word not in said] == []
    assert (folder / "run.h5").stat().st_mtime_ns == written


@pytest.mark.parametrize(
    ("name", "run", "words"),
    [
        ("rheology", "flow", ["mu_error", "anisotropy"]),
        ("jamming", "jamming", ["phi_J", "rattlers"]),
        ("analysis", "speeds", ["mu_s", "phi_c", "coordination", "exponent"]),
    ],
)
def test_notebooks_of_other_fields_read_a_run(
    name: str,
    run: str,
    words: list[str],
    copy: Callable[[str], Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder = copy(run)
    said = execute(f"{name}.ipynb", folder / "scene.toml", folder, monkeypatch)
    assert [word for word in words if word not in said] == []


def test_a_run_shows_its_progress_in_one_line(tmp_path: Path) -> None:
    scene = SCENES / "crossing.toml"
    values = {"shear.strain": 20.0, "sample.grains": 1000, "sample.length": 96e-6}
    call = f"simulate({str(scene)!r}, {str(tmp_path / 'out')!r}, ranks=1, values={values})"
    # Once more, a run that has ended.
    cells = [
        nbformat.v4.new_code_cell(code) for code in (f"from gshear import simulate\n{call};", call)
    ]
    messages = []

    class Client(nbclient.NotebookClient):
        def process_message(self, *arguments: Any, **named: Any) -> Any:
            messages.append(arguments[0])
            return super().process_message(*arguments, **named)

    notebook = nbformat.v4.new_notebook(cells=cells)
    Client(notebook, timeout=300, kernel_name="python3").execute()
    assert [output.output_type for output in cells[0].outputs] == ["display_data"]
    data = cells[0].outputs[0].data
    assert re.fullmatch(
        r"shear 100%, step ([\d,]+) of \1, strain 20.0\d*, done", data["text/plain"]
    )
    assert data["text/html"] == f"<progress value=1.0></progress> {data['text/plain']}"
    kinds = [message["msg_type"] for message in messages]
    assert kinds.count("display_data") == 1
    shown = [m["content"]["data"]["text/plain"] for m in messages if "_data" in m["msg_type"]]
    pattern = r"\w+ \d+%, step [\d,]+.*, \d:\d\d:\d\d left"
    assert any(re.fullmatch(pattern, text) for text in shown)
    assert [output.output_type for output in cells[1].outputs] == ["execute_result"]


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_are_stored_executed(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell.outputs]
    assert not any(output.output_type == "error" for output in outputs)
    assert path.stat().st_size < 700_000
    # Paths of the machine that executed it do not belong into the repository.
    texts = [output.get("text", "") for output in outputs]
    texts += [str(output.get("data", {}).get("text/plain", "")) for output in outputs]
    assert [text for text in texts if re.search(r"(^|[\s<'\"])/\w+/", text)] == []
