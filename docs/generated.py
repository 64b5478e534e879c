"""Pages that the code writes: the commands, the lists, the notebooks, the reports and their figures.

`python docs/generated.py` prints the table of estimators that `reference/estimators.md` holds.
"""

import re
import shutil
from collections.abc import Iterable
from pathlib import Path

import click
import typer

import cooploc as cl
from cooploc.analysis.report.tables import read_toml
from cooploc.cli import app
from cooploc.estimators import BUILTIN
from cooploc.scenarios.runner.trace import trace
from cooploc.terminal.names import about_estimator

TO_A_FILE = r"\[([^]]*)\]\((?:[^)]*\.(?:html|json|csv|py|pdf)|tables/[^)]*)\)"  # not a page: the text is enough
ROOT = Path(__file__).resolve().parents[1]
LISTS = {
    "scenarios": (
        "Scenarios",
        "What `cl.list_scenarios()` knows.",
        ["labels", "about", "source"],
    ),
    "studies": ("Studies", "What `cl.list_studies()` knows.", ["name", "takes", "about"]),
}


def write(folder: Path) -> None:
    """Write all pages."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / "commands.md").write_text(commands(), encoding="utf-8")
    for name, (title, about, columns) in LISTS.items():
        more = scenario_parameters() * (name == "scenarios")
        text = f"# {title}\n\n{about}\n\n{_table(name, columns)}\n{more}"
        (folder / f"{name}.md").write_text(text, encoding="utf-8")
    (folder / "figures.md").write_text(figures(), encoding="utf-8")
    (folder / "parameters.md").write_text(parameters(), encoding="utf-8")
    for notebook in sorted((ROOT / "notebooks").glob("*.ipynb")):
        shutil.copy(notebook, folder / notebook.name)
    for kept in (ROOT / "reports").rglob("*"):
        there = folder / kept.relative_to(ROOT)
        there.parent.mkdir(parents=True, exist_ok=True)
        if kept.suffix in (".png", ".svg"):
            shutil.copy(kept, there)
        elif kept.suffix == ".md" and kept.read_text("utf-8").startswith("# "):  # not a table for another page
            there.write_text(re.sub(TO_A_FILE, r"\1", kept.read_text("utf-8")), encoding="utf-8")


def commands() -> str:
    """The help of every command, as the terminal shows it."""
    root = typer.main.get_command(app)
    context = click.Context(root, info_name="cooploc")  # type: ignore[arg-type]
    pages = [("cooploc", root.get_help(context))]  # type: ignore[arg-type]
    for name in root.list_commands(context):  # type: ignore[attr-defined]
        command = root.get_command(context, name)  # type: ignore[attr-defined]
        below = click.Context(command, info_name=name, parent=context)
        pages.append((f"cooploc {name}", command.get_help(below)))
    shown = "\n\n".join(f"## {name}\n\n```text\n{text}\n```" for name, text in pages)
    return f"# The command line\n\n{shown}\n"


def figures() -> str:
    """Every function of `cl.plot`."""
    shown = "\n\n".join(
        f"```{{eval-rst}}\n.. autofunction:: cooploc.analysis.plot.{name}\n```" for name in dir(cl.plot)
    )
    return f"# Figures\n\n`cl.plot.NAME`; each takes and returns matplotlib `Axes`.\n\n{shown}\n"


def parameters() -> str:
    """What `cooploc list NAME` says of every built-in estimator."""
    shown = "\n\n".join(f"## {name}\n\n{_listed(about_estimator(name))}" for name in BUILTIN)
    return f'# Parameters of estimators\n\nWhat `cooploc list NAME` and `cl.show("NAME")` say.\n\n{shown}\n'


def scenario_parameters() -> str:
    """What stands in brackets of scenarios' labels."""
    known = read_toml("parameters.toml").items()
    lines = [f"| `{name}` | {one.get('unit', '')} | {one['meaning']} |" for name, one in known]
    head = "\n## Parameters\n\n`nlos[eta=2,obstacles=5]`; `cooploc list nlos` says which it has, and their values.\n\n"
    return "\n".join([f"{head}| name | unit | meaning |", "| --- | --- | --- |", *lines, ""])


def _listed(texts: Iterable[str]) -> str:
    """A docstring with its parameters as a list."""
    lines: list[str] = []
    for line in "\n\n".join(texts).replace("*", "\\*").splitlines():
        if begins := re.match(r" {4}(\w+): (.*)", line):
            lines.append(f"- `{begins[1]}`: {begins[2]}")
        else:
            lines += [line, ""] if line.endswith(":") else [line]
    return "\n".join(lines).strip()


def _table(kind: str, columns: list[str]) -> str:
    """A list as a pipe table."""
    found = getattr(cl, f"list_{kind}")()
    if "minutes" in found:
        found = found.assign(takes=[f"{m:g} min" if m == m else "" for m in found["minutes"]])
    lines = [columns, ["---"] * len(columns)]
    lines += [[str(row[c]).replace("|", "\\|") for c in columns] for row in found.to_dict("records")]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


SCENARIOS = ("robots-1-3/n=3[ticks=5]", "camera/n=3[ticks=20]")


def estimators() -> str:
    """A row for each built-in estimator: what it is, senses and sends, its bytes, consistency and source."""
    head = ["name", "what it is", "senses", "sends", "bytes per message", "known consistency", "source"]
    lines = [head, ["---"] * len(head)]
    for row in cl.list_estimators().set_index("name", drop=False).loc[list(BUILTIN)].to_dict("records"):
        name, about = f"`{row['name']}`", row["about"].partition(". ")[0].rstrip(".") + "."
        about += " **The bound** of all others." if row["bound"] else ""
        senses, made = row["uses"].replace("|", " or ").replace("_", " "), cl.make(row["name"])
        sends = getattr(made, "sends", "as its source says")
        consistency = getattr(made, "consistency", "not known")  # in theory; every table of results has what runs say
        lines.append([name, about, senses, sends, _bytes(row["name"]), consistency, row["source"]])
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _bytes(name: str) -> str:
    """The mean bytes of a message of three robots, where radio, and where cameras, see teammates."""
    found = []
    for label in SCENARIOS:
        try:
            sent = trace(name, cl.make(name), cl.simulate(label, trials=2, seed=1)[1])
        except cl.IncompatibleEstimator:
            continue
        if sent.messages.sum():
            found.append(f"{sent.bytes.sum() / sent.messages.sum():.0f}")
    return ", ".join(found)


if __name__ == "__main__":
    print(estimators())
