"""The run directory: `manifest.json`, and one part per (scenario, estimator, range of trials).

Every file is written under a temporary name, flushed to the disk and renamed, so whatever is there is whole. A part is
bit-identical whenever it is computed; its receipt has its checksum, what its bits depend on, and the time that was
measured, which is not bit-identical. Every JSON file has a checksum of its own content.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from filelock import FileLock, Timeout

from cooploc.analysis.execution.atomic_file import remove_temporary, replace
from cooploc.analysis.execution.listed_parts import ListedParts, file_names
from cooploc.analysis.execution.manifest_file import (
    NAME,
    DamagedManifest,
    continued,
    read_manifest,
    refuse_foreign,
    settings,
)
from cooploc.analysis.execution.part_file import failures, read_part, together
from cooploc.analysis.execution.piece import Piece as Piece
from cooploc.analysis.execution.piece import trials_of
from cooploc.analysis.execution.schemas import FORMAT as FORMAT
from cooploc.analysis.execution.schemas import Newer, OldReceipt, Receipt, checked
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.sealed import Damaged, seal

FOLDERS = ("parts", "receipts")


class Pieces(NamedTuple):
    """What a directory holds of one scenario and estimator."""

    intact: list[Piece]  # which together hold each trial at most once
    damaged: list[Piece]  # whose parts are not what was written


class RunDir:
    """A directory of results that can be continued."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._known: dict[str, Any] = {}  # the manifest that is there, once it was read
        self._seen: dict[Piece, tuple[tuple[int, int], float]] = {}  # of intact parts: `_state`, and their seconds
        self._listed = ListedParts(path / "parts")

    @property
    def manifest(self) -> dict[str, Any]:
        """What the directory says it holds; empty where there is none yet.

        Raises:
            BadInput: the directory holds something else, or a newer format.
            DamagedManifest: it is not what was written.

        """
        return read_manifest(self.path)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keeps other runs from writing here; the lock ends with its process, however that ends.

        Raises:
            BadInput: another process is writing here.

        """
        refuse_foreign(self.path)  # before anything is written there
        self.path.mkdir(parents=True, exist_ok=True)
        lock = FileLock(self.path / ".lock")
        try:
            lock.acquire(timeout=0)
        except Timeout:
            raise BadInput(f"another run is writing to {self.path}: wait for it, or name another with --out") from None
        try:
            yield
        finally:
            lock.release()

    def open(self, manifest: dict[str, Any]) -> list[str]:
        """Begin or continue a run; a damaged manifest is made again where every part agrees with what is asked.

        Returns:
            What the user should know of what was found there, a line each.

        Raises:
            BadInput: the directory holds a run of other settings.

        """
        remarks = []
        for folder in (".", *FOLDERS):
            remove_temporary(self.path / folder)
        try:
            found = self.manifest
        except DamagedManifest as damaged:
            self._demand_agreement(manifest, damaged)
            remarks.append(f"{self.path / NAME} was damaged or gone; all parts agree, and it is made again")
        else:
            manifest = continued(self.path, found, manifest) if found else manifest
        self.write_manifest(manifest)
        for folder in FOLDERS:
            (self.path / folder).mkdir(parents=True, exist_ok=True)
        return remarks + self.foreign()

    def foreign(self) -> list[str]:
        """A line for each file among the parts and receipts that no run wrote."""
        return [
            f"{self.path / folder / name} is not of this run, and ignored"
            for folder in FOLDERS
            for name in file_names(self.path / folder)
            if not trials_of(name)
        ]

    def _demand_agreement(self, asked: dict[str, Any], damaged: DamagedManifest) -> None:
        """Refuse a damaged manifest unless there are parts, and each that is asked for was computed as it is now."""
        agree = 0
        for scenario, cell in asked["cells"].items():
            for estimator in cell["estimators"]:
                for trials in self.held(scenario, estimator):
                    piece = Piece(scenario, estimator, trials)
                    receipt = self._receipt(piece)
                    if receipt and receipt.get("settings") != settings(asked, piece):
                        raise damaged
                    agree += bool(receipt)
        if not agree:
            raise damaged

    def write_manifest(self, manifest: dict[str, Any]) -> None:
        """Replace the manifest."""
        text = json.dumps(seal(manifest), indent=1) + "\n"
        replace(self.path / NAME, lambda file: file.write_text(text, encoding="utf-8"))
        self._known = {}

    def write(self, piece: Piece, frame: pd.DataFrame, seconds: float) -> None:
        """Keep one part; it counts as done once it is there, and its receipt is there before it.

        Raises:
            OSError: it cannot be written: a full disk, no permission; names the file.

        """
        failed = int(frame.loc[frame["failure"].notna(), "trial"].nunique()) if "failure" in frame else 0
        known = {"format": FORMAT, "seconds": seconds, "settings": self._settings(piece), "failed": failed}

        def write(file: Path) -> None:
            frame.to_parquet(file, index=False)
            receipt = json.dumps(seal({**known, "sha256": _checksum(file)}))
            replace(self._receipt_path(piece), lambda temporary: temporary.write_text(receipt, encoding="utf-8"))

        replace(self._part_path(piece), write)
        self._seen[piece] = self._state(piece), seconds
        self._listed.forget()

    def pieces(self, scenario: str, estimator: str, count: int) -> Pieces:
        """What there is of the trials below `count`; each part is read once, to compare it with its checksum."""
        found = Pieces([], [])
        reached = 0
        for trials in self.held(scenario, estimator):
            if reached <= trials.start < count:
                piece = Piece(scenario, estimator, trials)
                if self.intact(piece):
                    found.intact.append(piece)
                    reached = trials.stop
                else:
                    found.damaged.append(piece)
        return found

    def intact(self, piece: Piece) -> bool:
        """Whether a part is there, is what was written, and was computed as the manifest says."""
        try:
            state = self._state(piece)
            if piece in self._seen and self._seen[piece][0] == state:
                return True
            receipt = self._receipt(piece)
            same: bool = _checksum(self._part_path(piece)) == receipt.get("sha256")
            same = same and receipt.get("settings") in (None, self._settings(piece))
        except OSError:
            return False
        if same:
            self._seen[piece] = state, float(receipt["seconds"])
        return same

    def read(self, piece: Piece) -> pd.DataFrame:
        """An intact part, with its seconds, by trial and robot.

        Raises:
            BadInput: it holds something else, though it has a receipt.

        """
        return self.rows([(piece, piece.trials.stop)])

    def rows(self, pieces: Iterable[tuple[Piece, int]]) -> pd.DataFrame:
        """As `read`, of many parts one after the other; of each the trials below a number."""
        return together(self._part(piece, below) for piece, below in pieces)

    def _part(self, piece: Piece, below: int) -> pa.Table:
        part = read_part(self._part_path(piece), *piece)
        known = self._seen.get(piece)
        seconds = known[1] if known else float(self._receipt(piece)["seconds"])
        part = part.append_column("seconds", pa.repeat(seconds, len(part)))
        return part if piece.trials.stop <= below else part.filter(pc.field("trial") < below)

    def failures(self, piece: Piece) -> list[str]:
        """Why trials of an intact part failed, each reason once."""
        none_failed = self._receipt(piece).get("failed") == 0
        return [] if none_failed else sorted(set(failures(self._part_path(piece))["failure"]))

    def held(self, scenario: str, estimator: str) -> list[range]:
        """The trials whose parts are there, whole or not, by their files' names."""
        return self._listed.of(Piece(scenario, estimator, range(0)).stem)

    def _settings(self, piece: Piece) -> str:
        self._known = self._known or self.manifest
        return settings(self._known, piece)

    def _state(self, piece: Piece) -> tuple[int, int]:
        """What changes when a part's file does."""
        file = self._part_path(piece)
        if not file.is_file():
            raise FileNotFoundError(2, "No such file", str(file))
        return file.stat().st_mtime_ns, file.stat().st_ino

    def _receipt(self, piece: Piece) -> dict[str, Any]:
        """The receipt of a part; empty where there is none, or a damaged one."""
        try:
            text = self._receipt_path(piece).read_bytes() if self._receipt_path(piece).is_file() else b""
            return checked(text, Receipt if b'"format"' in text else OldReceipt)
        except (OSError, Damaged, Newer):
            return {}

    def _part_path(self, piece: Piece) -> Path:
        return self.path / "parts" / f"{piece.name}.parquet"

    def _receipt_path(self, piece: Piece) -> Path:
        return self.path / "receipts" / f"{piece.name}.json"


def _checksum(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
