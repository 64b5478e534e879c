"""Which trials of a run have parts on disk, by the names of their files."""

from pathlib import Path

from cooploc.analysis.execution.piece import stem_of, trials_of


def file_names(folder: Path) -> list[str]:
    """Names of the finished files of a folder; empty where there is no folder."""
    names = (file.name for file in folder.iterdir()) if folder.is_dir() else ()
    return sorted(name for name in names if not (name.startswith(".") and name.endswith(".tmp")))


class ListedParts:
    """The parts of a folder, which is listed again when it changes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._at, self._found = 0, dict[str, list[range]]()  # when it was listed; of each stem the trials

    def of(self, stem: str) -> list[range]:
        """The trials whose parts are there, whole or not."""
        changed = self.folder.stat().st_mtime_ns if self.folder.is_dir() else 0
        if self._at != changed or not changed:
            found: dict[str, list[range]] = {}
            for name in file_names(self.folder):
                if name.endswith(".parquet") and (trials := trials_of(name)):
                    found.setdefault(stem_of(name), []).append(trials)
            self._at, self._found = changed, found
        return sorted(self._found.get(stem, []), key=lambda trials: (trials.start, trials.stop))

    def forget(self) -> None:
        """List it again, though it may look the same: two files can be written within one tick of its clock."""
        self._at = 0
