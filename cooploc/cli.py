"""The command line. Every command imports what it needs when it runs."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    name="cooploc",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback(invoke_without_command=True)
def root(context: typer.Context) -> None:
    """Compare estimators for multi-robot cooperative localization fairly."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


class Kind(StrEnum):
    """What can be listed."""

    estimators = "estimators"
    scenarios = "scenarios"
    studies = "studies"


@app.command(name="list")
def list_(
    kind: Annotated[Kind | None, typer.Argument(help="only these")] = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="the README's table of estimators")] = False,
) -> None:
    """List estimators, scenarios and studies, and plug-ins that could not be loaded."""
    from cooploc.terminal import lists

    if markdown:
        from cooploc.catalogue import markdown as table

        typer.echo(table())
        return

    for one in [kind] if kind else list(Kind):
        lists.show(one.value)


@app.command()
def run(
    study: Annotated[str, typer.Argument(help="a shipped study, or the path of a study's TOML file")],
    trials: Annotated[int | None, typer.Option(help="trials of each scenario")] = None,
    seed: Annotated[int | None, typer.Option(help="of everything random")] = None,
    estimators: Annotated[str | None, typer.Option(help="a,path.py:B: these instead of the study's")] = None,
    jobs: Annotated[int, typer.Option(help="processes")] = 1,
    scheduler: Annotated[str | None, typer.Option(help="of a Dask cluster, tcp://HOST:PORT")] = None,
    data: Annotated[Path | None, typer.Option(help="directory of recordings")] = None,
    out: Annotated[Path | None, typer.Option(help="run directory [default: runs/STUDY-seedN]")] = None,
    check: Annotated[bool, typer.Option(help="check estimators that are not built in before they run")] = True,
    as_json: Annotated[bool, typer.Option("--json", help="print the table as JSON and nothing else on stdout")] = False,
) -> None:
    """Run a study, print its table, and keep results and picture in the run directory."""
    from cooploc.analysis.execution.execute import execute
    from cooploc.analysis.metrics.compare import compare
    from cooploc.estimators import split
    from cooploc.scenarios.studies.study import load
    from cooploc.terminal import results
    from cooploc.terminal.progress import TerminalProgress

    wanted = None if estimators is None else split(estimators)
    asked = load(study).with_options(trials=trials, seed=seed, only=wanted)
    folder = out or Path("runs") / f"{asked.name}-seed{asked.seed}"
    with TerminalProgress() as progress:
        rows = execute(asked, folder, data=data, jobs=jobs, scheduler=scheduler, check=check, progress=progress)
    table = compare(rows, asked.baselines(), full=True)
    results.keep(table, rows, folder)
    results.show(table, rows, folder, as_json)
    if rows["failure"].notna().any():
        raise typer.Exit(1)


@app.command()
def show(folder: Annotated[Path, typer.Argument(help="a run directory")]) -> None:
    """Say what a run holds, what is missing, and what failed and why."""
    from cooploc.terminal import run_contents

    run_contents.show(folder)


@app.command()
def check(
    estimator: Annotated[str, typer.Argument(help="an estimator's name, or path.py:Name")],
    seed: Annotated[int, typer.Option(help="of the streams it is tried on")] = 0,
) -> None:
    """Check that an estimator cannot cheat and keeps to the interface."""
    from cooploc.estimators import make
    from cooploc.scenarios.conformance.check import check_estimator

    result = check_estimator(make(estimator), name=estimator, seed=seed)
    typer.echo(result.table())
    if not result.passed:
        raise typer.Exit(1)


@app.command()
def new_estimator(
    name: Annotated[str, typer.Argument(help="small letters, digits and hyphens, such as my-filter")],
) -> None:
    """Write a small package with an estimator that runs, its test, and what registers it."""
    from cooploc.scaffold import create

    for file in create(name, Path(name)):
        typer.echo(file)
    typer.echo(f"next: pip install -e {name} && cooploc run quick --estimators mrsl-rssi,{name}")


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(help="a run directory")],
    out: Annotated[Path | None, typer.Option("-o", "--out", help="directory [default: RUN/report]")] = None,
    ledger: Annotated[Path | None, typer.Option(help="a ledger's TOML file [default: that of the paper]")] = None,
) -> None:
    """Write a run's report: an HTML page that needs no network, and its tables as LaTeX, Markdown and CSV."""
    from cooploc.terminal import finished_runs

    finished_runs.report(folder, out or folder / "report", ledger)


@app.command()
def verdicts(
    folder: Annotated[Path, typer.Argument(help="a run directory")],
    ledger: Annotated[Path | None, typer.Option(help="a ledger's TOML file [default: that of the paper]")] = None,
) -> None:
    """Print which claims of a ledger a run supports, contradicts or leaves open."""
    from cooploc.terminal import finished_runs

    finished_runs.verdicts(folder, ledger)


@app.command()
def compare(
    before: Annotated[Path, typer.Argument(help="a run directory")],
    after: Annotated[Path, typer.Argument(help="another run directory")],
) -> None:
    """Say what changed from one run to another, trial by trial where their streams are the same."""
    from cooploc.terminal import finished_runs

    finished_runs.compare(before, after)


@app.command()
def reproduce(
    page: Annotated[Path, typer.Argument(help="a report's directory or its page")],
    trials: Annotated[int, typer.Option(min=1, help="that are run again, of those the report embeds")] = 6,
    data: Annotated[Path | None, typer.Option(help="directory of recordings")] = None,
) -> None:
    """Run some of a report's trials again: exit code 0 where all are bit-equal, 1 where any differs."""
    from cooploc.terminal import finished_runs

    if not finished_runs.reproduce(page, trials, data):
        raise typer.Exit(1)
