"""Every notebook runs from top to bottom, from any working directory, and keeps its outputs."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

# What is kept in the notebooks comes from their own settings; here they run on fewer trials and shorter recordings.
SMALL = {
    "01_first_comparison": [
        ('"robots-1-3/n=3", trials=20', '"robots-1-3/n=3", trials=5'),
        ('"nlos", trials=20', '"nlos", trials=5'),
    ],
    "02_the_paper": [("trials=10", "trials=3")],
    "04_real_robots": [
        ("duration=60.0", "duration=10.0"),
        ('"mrclam/all", data=DATA / "mrclam6"', '"mrclam/all", data=DATA / "mrclam6", duration=60.0'),
        ("range(11)", "range(2)"),
    ],
    "06_tuned_alike": [
        ("budget=60", "budget=9"),
        ("trials=10", "trials=3"),
        ('"mrsl-rssi", "mrsl-distance", "ekf-local", "ekf-joint"', '"mrsl-distance"'),
    ],
}
AUTHOR = "03_write_an_estimator"
NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
@pytest.mark.slow
def test_a_notebook_runs_beside_folders_named_like_ours(notebook, tmp_path):
    for folder in ("analysis", "estimators", "scenarios"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "__init__.py").write_text("raise ImportError('the wrong folder')")
    done = run(notebook, tmp_path, {})
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_keeps_its_outputs_without_the_machine_s_paths_and_imports_cooploc_alone(notebook):
    code = cells(notebook)
    assert all(cell["outputs"] for cell in code[1:]), "a cell was kept without its output"
    outputs = [output for cell in code for output in cell["outputs"]]
    assert {output["output_type"] for output in outputs} <= {"stream", "display_data", "execute_result"}
    assert not [output for output in outputs if output.get("name") == "stderr"]
    for output in outputs:
        text = "".join(output.get("text", output.get("data", {}).get("text/plain", "")))
        assert not re.search(r"skipped|(^|[\s'\"])(/|[A-Z]:\\)\w", text)
    public = ("estimators.interface", "estimators.models", "estimators.kalman")  # for authors, as the README promises
    found = re.findall(r"(?:from|import) cooploc\.([\w.]+)", "\n".join("".join(cell["source"]) for cell in code))
    assert [module for module in found if notebook.stem != AUTHOR or not module.startswith(public)] == []


@pytest.mark.slow
def test_what_needs_recordings_is_skipped_with_a_reason_where_there_are_none(tmp_path):
    (notebook,) = (path for path in NOTEBOOKS if path.stem == "04_real_robots")
    alone = re.compile("import|if (mrclam|wifi):")  # other cells need no recordings
    done = run(notebook, tmp_path, {"COOPLOC_DATA": str(tmp_path / "nowhere")}, alone)
    assert done.returncode == 0, done.stderr
    said = [line for line in done.stdout.splitlines() if line.startswith("skipped: ")]
    needing = [cell for cell in cells(notebook) if re.match("if (mrclam|wifi):", "".join(cell["source"]))]
    assert len(said) == len(needing) > 0


def cells(notebook):
    """The cells of code."""
    found = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return [cell for cell in found if cell["cell_type"] == "code"]


def run(notebook, folder, environment, which=re.compile("")):
    """The notebook's code as a script, in a working directory of its own; cells that begin as `which` says."""
    source = "\n".join(filter(which.match, ("".join(cell["source"]) for cell in cells(notebook))))
    for kept, small in SMALL.get(notebook.stem, ()):
        assert source.count(kept) == 1, f"{kept} is not a setting of {notebook.stem}: change SMALL with the notebook"
        source = source.replace(kept, small)
    script = folder / "notebook.py"
    script.write_text(source, encoding="utf-8")
    environment = {**os.environ, "MPLBACKEND": "agg", "TMPDIR": str(folder), **environment}
    return subprocess.run([sys.executable, str(script)], cwd=folder, env=environment, capture_output=True, text=True)
