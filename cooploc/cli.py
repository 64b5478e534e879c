"""The command line: each command calls the function of `cooploc` that does the same from Python, and prints the result.

Every command imports what it needs when it runs, so that `cooploc --help` is quick.
"""

import os
import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

import cooploc as cl
from cooploc import terminal

app = typer.Typer(
    name="cooploc",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)


# Arguments and options that several commands have.

StudyName = Annotated[
    str,
    typer.Argument(
        help="a shipped study, a problem such as arena-3@1, a study's TOML file, or with --estimators a scenario"
    ),
]
Estimators = Annotated[str | None, typer.Option(help="comma-separated estimators, instead of the study's")]
Jobs = Annotated[int, typer.Option(help="number of processes")]
RunDirectory = Annotated[Path, typer.Argument(help="a run directory")]
Recordings = Annotated[Path | None, typer.Option(help="directory of recordings")]
Isolate = Annotated[bool, typer.Option(help="give what is not built in processes of its own, where it may crash")]
Strict = Annotated[bool, typer.Option("--strict", help="refuse a recording with any line that cannot be read")]
Claims = Annotated[Path | None, typer.Option(help="TOML file of claims [default: those of the paper]")]
Seed = Annotated[int | None, typer.Option(help="random seed")]
Out = Annotated[Path | None, typer.Option(help="run directory [default: runs/STUDY-seedN]")]
Wide = Annotated[bool, typer.Option("--wide", help="print every column, however wide")]
Legend = Annotated[bool, typer.Option("--legend", help="say what columns and words mean")]
AsJson = Annotated[bool, typer.Option("--json", help="print the table as JSON, and nothing else on stdout")]


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="print the version")] = False
) -> None:
    """Compare estimators for multi-robot cooperative localization fairly."""
    if version:
        typer.echo(f"cooploc {cl.__version__}")
        return
    os.environ.setdefault("MPLBACKEND", "agg")  # pictures go to files
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


KINDS = ("estimators", "scenarios", "studies", "problems")


@app.command(name="list")
def list_(
    what: Annotated[str, typer.Argument(help=f"{', '.join(KINDS)} [default: all of them], or one name of these")] = "",
) -> None:
    """List estimators, scenarios, studies and problems, or say what one is."""
    from cooploc.estimators.errors import nearest
    from cooploc.terminal.names import all_names, show_list, show_name

    if what and what not in KINDS:
        if not show_name(what):
            raise cl.BadInput(f"nothing is called {what!r}; {nearest(what, all_names())}")
        return
    for one in [what] if what else KINDS:
        show_list(one, getattr(cl, f"list_{one}")())
    typer.echo("next: cooploc list ctrn (what its parameters mean), or cooploc run quick --estimators arl,ctrn")


@app.command()
def problems() -> None:
    """List problems that a paper can name."""
    list_("problems")


@app.command()
def run(
    study: StudyName,
    trials: Annotated[int | None, typer.Option(help="trials per scenario")] = None,
    seed: Seed = None,
    estimators: Estimators = None,
    jobs: Jobs = 1,
    scheduler: Annotated[str | None, typer.Option(help="run on a Dask cluster: tcp://HOST:PORT")] = None,
    data: Recordings = None,
    out: Out = None,
    check: Annotated[bool, typer.Option(help="check estimators that are not built in before they run")] = True,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="run again every trial that failed")] = False,
    isolate: Isolate = True,
    strict: Strict = False,
    as_json: AsJson = False,
    wide: Wide = False,
    legend: Legend = False,
    sort: Annotated[str, typer.Option(help="column of table.csv by which rows are printed, or study")] = "rmse",
    until_decided: Annotated[bool, typer.Option("--until-decided", help="as --max-trials 1000")] = False,
    max_trials: Annotated[int | None, typer.Option(help="stop what is decided after 10, 20, ... up to so many")] = None,
) -> None:
    """Run a study, print its table, keep results and picture."""
    how: dict[str, Any] = {"seed": seed, "estimators": estimators, "jobs": jobs, "scheduler": scheduler, "data": data}
    how |= {"out": out, "check": check, "retry_failed": retry_failed, "isolate": isolate, "strict": strict}
    most = 1000 if until_decided and max_trials is None else max_trials
    results = cl.run_study(study, trials=trials, max_trials=most, **how)
    terminal.tables.show_results(results.table, results.rows, results.folder, as_json, wide, legend, sort)
    if len(results.failures):
        raise typer.Exit(1)


@app.command()
def tune(
    study: StudyName,
    budget: Annotated[int, typer.Option(help="training trials that each estimator may use")] = 100,
    estimators: Estimators = None,
    trials: Annotated[int | None, typer.Option(help="fresh trials per scenario, to compare on")] = None,
    seed: Annotated[int | None, typer.Option(help="random seed; that of training is derived from it")] = None,
    objective: Annotated[str, typer.Option(help="nll: log-likelihood of the true position, or rmse")] = "nll",
    jobs: Jobs = 1,
    data: Recordings = None,
    out: Annotated[Path | None, typer.Option(help="directory [default: runs/STUDY-seedN-tuned]")] = None,
    check: Annotated[bool, typer.Option(help="check estimators that are not built in before they are compared")] = True,
    isolate: Isolate = True,
) -> None:
    """Tune all estimators with one budget, and compare them.

    They are compared on other streams than they are tuned on.
    """
    how: dict[str, Any] = {"estimators": estimators, "trials": trials, "seed": seed, "jobs": jobs, "data": data}
    found = cl.tune(study, budget, objective=objective, out=out, check=check, isolate=isolate, **how)
    orders = {"RMSE": found.order("rmse"), "NLL": found.order("nll")}
    terminal.tables.show_tuning(found.history, found.table, orders, found.record)
    typer.echo(f"tables and figures: {found.folder}\nstudy: {found.study}")
    typer.echo(f"next: cooploc run {shlex.quote(str(found.study))}")
    if found.rows["failure"].notna().any():
        raise typer.Exit(1)


@app.command()
def inspect(
    path: Annotated[Path, typer.Argument(help="directory of CSV files, a ROS bag, a PyFG file or MRCLAM text")],
    out: Annotated[Path | None, typer.Option(help="directory for log.toml and sketch [default: beside it]")] = None,
    run: Annotated[str, typer.Option(help="which recording of several [default: the first]")] = "",
    force: Annotated[bool, typer.Option("--force", help="guess again, and replace a log.toml that is there")] = False,
    strict: Strict = False,
) -> None:
    """Look at a recording of robots, and draft its log.toml.

    Says what is in it and what is odd about it, sketches it, and writes a log.toml that runs.
    """
    found = cl.inspect(path, run, again=force)
    if strict:
        from cooploc.scenarios.scenario import require_no_faults

        require_no_faults(found.inspected.faults)
    terminal.tables.show_inspection(found, found.write(out, force))


@app.command()
def plan(
    study: StudyName,
    difference: Annotated[float, typer.Option(help="change of RMSE to be shown; 0.1 is 10 %")] = 0.1,
    seed: Seed = None,
    estimators: Estimators = None,
    jobs: Jobs = 1,
    data: Recordings = None,
    out: Out = None,
    isolate: Isolate = True,
) -> None:
    """Say how many trials comparisons need, and for how long.

    With these a true difference of that size is found in four of five studies (80 % power).
    """
    how: dict[str, Any] = {"seed": seed, "estimators": estimators, "jobs": jobs, "data": data, "out": out}
    terminal.tables.show_plan(cl.plan(study, difference=difference, isolate=isolate, **how), difference, jobs)
    asked = ["cooploc", "run", study, *(["--estimators", estimators] if estimators else [])]
    typer.echo(f"next: {shlex.join(asked)} --until-decided, or --trials N")


@app.command()
def show(folder: RunDirectory) -> None:
    """Say what a run holds, what is missing, what failed and why."""
    cl.show(folder)


@app.command()
def check(
    estimator: Annotated[str, typer.Argument(help="an estimator's name, or path.py:Name")],
    seed: Annotated[int, typer.Option(help="random seed of the streams it is tried on")] = 0,
    time_limit: Annotated[float, typer.Option(help="seconds of all checks of what is not built in")] = 600.0,
    isolate: Isolate = True,
    scenario: Annotated[
        list[str] | None, typer.Option(help="one with a channel that the small worlds of the checks lack")
    ] = None,
    data: Recordings = None,
) -> None:
    """Check that an estimator cannot cheat and keeps the rules."""
    from cooploc.terminal.console import make_console

    with make_console(stderr=True).status("checking; a slow filter takes minutes"):
        result = cl.check_estimator(estimator, None, seed, isolate, time_limit, scenario or (), data)
    terminal.tables.show_checks(result, scenario[0] if scenario else "", data)
    if not result.passed:
        raise typer.Exit(1)


@app.command()
def judge(
    tum: Annotated[
        list[str],
        typer.Option(help="[NAME=]PLACE of trajectories of another program: folder, file or bag; may be given again"),
    ],
    stream: Annotated[str, typer.Argument(help="a file that Stream.save wrote, or a scenario")] = "",
    truth: Annotated[
        Path | None, typer.Option(help="[WORD=]PLACE of true trajectories, instead of a stream: folder, file or bag")
    ] = None,
    align: Annotated[str, typer.Option(help="with --truth: none, or origin, se2 (each robot), team (all)")] = "none",
    axes: Annotated[str, typer.Option(help="with --truth: covariances are in axes of the world or the body")] = "world",
    pieces: Annotated[int, typer.Option(help="with --truth: of the recording, for intervals over them")] = 10,
    within: Annotated[float, typer.Option(help="with --truth: seconds between stamps that belong together")] = 0.01,
    out: Annotated[Path | None, typer.Option(help="folder of a page, tables and a figure")] = None,
    estimators: Annotated[str | None, typer.Option(help="comma-separated estimators to run on the same stream")] = None,
    trials: Annotated[int | None, typer.Option(help="of a scenario [default: 1]")] = None,
    seed: Annotated[int | None, typer.Option(help="of a scenario [default: 0]")] = None,
    data: Recordings = None,
    offline: Annotated[bool, typer.Option("--offline", help="they saw later readings, as smoothers do")] = False,
    as_json: AsJson = False,
    wide: Wide = False,
    legend: Legend = False,
) -> None:
    """Judge the trajectories that other programs wrote.

    By a stream's truth, or by true trajectories in files, with covariances where there are some.
    `--tum mine=DIR --tum theirs=DIR2` ranks several. Formats: docs/how-to/judge.md.
    """
    parted = [("", "", one) if Path(one).exists() or "=" not in one else one.partition("=") for one in tum]
    named = {name or Path(path).name: path for name, _, path in parted}  # a folder's own name may hold "="
    if bool(stream) == bool(truth):
        raise cl.BadInput("name a stream or scenario, or --truth DIR: one of them")
    if stream and (align, axes, pieces, within) != ("none", "world", 10, 0.01):
        raise cl.BadInput("--align, --axes, --pieces and --within go with --truth: leave them out")
    if truth and (estimators, trials, seed, data, offline) != (None, None, None, None, False):
        raise cl.BadInput("--estimators, --trials, --seed, --data and --offline go with a stream: leave them out")
    if len(named) < len(tum):
        raise cl.BadInput("two of --tum have one name: write NAME=DIR")
    from cooploc.terminal.judge import show_external, show_trajectories

    shown = {"as_json": as_json, "every_column": wide, "legend": legend}
    if truth:
        show_trajectories(truth, named, align, axes, pieces, within, out, **shown)
    else:
        given = named if parted[0][0] or len(tum) > 1 else tum[0]
        show_external(stream, given, estimators, offline, out, {"trials": trials, "seed": seed, "data": data}, **shown)


@app.command()
def new_estimator(
    name: Annotated[str, typer.Argument(help="small letters, digits and hyphens, such as my-filter")],
) -> None:
    """Write a small package with an estimator and its test."""
    for file in cl.new_estimator(name):
        typer.echo(file)
    typer.echo(f"next: pip install -e {name} && cooploc run quick --estimators mrsl-rssi,{name}")


@app.command()
def report(
    folder: RunDirectory,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="directory [default: in the run directory]")] = None,
    ledger: Claims = None,
    only: Annotated[str, typer.Option("--only", "--estimators", help="show these estimators alone")] = "",
    scenarios: Annotated[str, typer.Option(help="show these scenarios alone; packet-drop is all of that name")] = "",
    baseline: Annotated[str, typer.Option(help="what all others are compared with [default: that of the run]")] = "",
    paper: Annotated[bool, typer.Option("--paper", help="figures, LaTeX tables and .bib, instead of the page")] = False,
    figures: Annotated[str, typer.Option(help="of the paper: rmse, anees, bytes, seconds")] = "",
    columns: Annotated[str, typer.Option(help="of the paper's tables, such as rmse,change,anees,bytes")] = "",
    everything: Annotated[bool, typer.Option("--all", help="every figure and table of the paper")] = False,
) -> None:
    """Write a run's report for the browser, or for a paper.

    An HTML page that needs no network, and its tables as LaTeX, Markdown and CSV; with --paper, three figures and a
    table that fit its columns. Lists are separated by commas.
    """
    chosen = {"estimators": only, "scenarios": scenarios, "baseline": baseline}
    if not (paper or figures or columns or everything):
        page = cl.report(folder, out, ledger, **chosen)
        typer.echo(f"report: {page}\ntables: {page.parent / 'tables'}")
        return
    example = cl.paper(folder, out, columns, **chosen, figures=figures, everything=everything)
    terminal.tables.show_paper(example)


@app.command()
def verdicts(folder: RunDirectory, ledger: Claims = None, wide: Wide = False, legend: Legend = False) -> None:
    """Say which of a paper's claims a run supports.

    And which it contradicts or leaves open, with the numbers.
    """
    from cooploc import api
    from cooploc.analysis.claims.ledger import load

    found, mapped = api.verdicts_and_readings(folder, ledger)
    terminal.tables.show_verdicts(found, load(ledger), wide, legend)
    terminal.tables.show_interpretations(mapped, wide, legend)
    place = shlex.quote(str(folder))
    typer.echo(f"next: cooploc report {place} (a page with these verdicts); --legend says what words mean")


@app.command()
def compare(
    before: RunDirectory,
    after: Annotated[Path, typer.Argument(help="another run directory")],
    markdown: Annotated[
        bool, typer.Option("--markdown", help="print Markdown, for the summary of a job in CI")
    ] = False,
    fail_if: Annotated[
        str, typer.Option(help="worse: exit code 1 where an error grew; different: where any bit did")
    ] = "",
    wide: Wide = False,
) -> None:
    """Say what changed from one run to another.

    Trial by trial where their streams are the same.
    """
    found, title = cl.compare_runs(before, after), f"from {before} to {after}"
    if markdown:
        typer.echo(found.markdown(title))
    else:
        terminal.tables.show_changes(title, found.settings, found.table, found.sentences, wide)
        typer.echo(f"next: cooploc report {shlex.quote(str(after))}; --wide prints what is bit-equal, too")
    if fail_if and found.is_any(fail_if):
        raise typer.Exit(1)


@app.command()
def reproduce(
    page: Annotated[Path, typer.Argument(help="a run's directory, or a report's, or its page")],
    trials: Annotated[int, typer.Option(min=1, help="how many of its trials to run again")] = 6,
    data: Recordings = None,
    trust: Annotated[bool, typer.Option("--trust", help="run Python files that it names")] = False,
) -> None:
    """Run some trials of a run or report again, and compare.

    Exit code 0 where all are bit-equal, 1 where any differs.
    """
    found = cl.reproduce(page, trials, data, trust)
    terminal.tables.show_reproduced(found.table, found.differences)
    if not found.equal:
        raise typer.Exit(1)


@app.command()
def board(
    runs: Annotated[list[Path], typer.Argument(help="run directories that cooploc reproduce has confirmed")],
    out: Annotated[Path, typer.Option("-o", "--out", help="directory of the site")] = Path("site"),
    reproduce_first: Annotated[bool, typer.Option("--reproduce", help="confirm runs that are not, first")] = False,
    data: Recordings = None,
) -> None:
    """Write a site of runs, with groups of ties, not ranks.

    It has a page an estimator. Each row needs a run that `cooploc reproduce` has confirmed. No code that is not built
    in runs.
    """
    typer.echo(f"board: {cl.board(runs, out, reproduce_first, data)}")
