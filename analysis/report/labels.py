"""Names of estimators in tables and figures: parameters that a study names, or that are long, as a word or a letter."""

import string
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from cooploc.estimators.label_syntax import shorten_labels

LONGEST = 24  # characters of a label that is written in full


class Labels(NamedTuple):
    """Names of estimators in figures and tables."""

    short: dict[str, str]  # by the estimator's full label
    settings: dict[str, str]  # letter -> parameters that it stands for

    def shorten(self, label: str) -> str:
        """Return the short label, or the label itself."""
        return self.short.get(label, shorten_labels(label))

    def legend(self, labels: Iterable[str]) -> list[str]:
        """Return the letters in these estimators' labels, each with the parameters that it stands for."""
        named = [(label, self.shorten(label)) for label in labels]
        used = {short.rpartition(" [")[2].removesuffix("]") for label, short in named if short != label}
        return [f"[{letter}] {settings}" for letter, settings in self.settings.items() if letter in used]


def variants_of(study: Mapping[str, Any]) -> dict[str, str]:
    """Return the names that a study of a manifest gives to parameters."""
    return {key: text for one in (*study.get("also", ()), study) for key, text in one.get("variants", {}).items()}


def short_labels(labels: Iterable[str], variants: Mapping[str, str] | None = None, longest: int = LONGEST) -> Labels:
    """Return a short label for each that has a name in `variants`, "ekf-local [raw]", or is longer than `longest`.

    The latter have letters, equal settings equal ones: "ekf-local[anchor_reading=rssi]" becomes "ekf-local [a]".
    """

    def sort_parameters(parameters: str) -> tuple[str, ...]:
        return tuple(sorted(part.strip() for part in parameters.split(",")))

    names = {sort_parameters(parameters): name for name, parameters in (variants or {}).items()}
    letters: dict[str, str] = {}
    short: dict[str, str] = {}
    written = {label: shorten_labels(label) for label in dict.fromkeys(labels)}
    files = Counter(method.rpartition("/")[2] for method in {text.partition("[")[0] for text in written.values()})
    for label, shown in written.items():
        method, _, settings = shown.removesuffix("]").partition("[")
        if files[without := method.rpartition("/")[2]] == 1:
            method = without  # of an estimator in a file, where no other folder has one of its name
        shown = f"{method}[{settings}]" if settings else method
        name = names.get(sort_parameters(settings)) if settings else None
        if len(method) > longest:
            method, settings = method[: longest - 1] + "…", ",".join(filter(None, (method, settings)))
        if not settings or (len(shown) <= longest and not name):
            short[label] = shown if settings else method
            continue
        again, place = divmod(len(letters), 26)
        letter = name or string.ascii_lowercase[place] + (str(again) if again else "")
        short[label] = f"{method} [{letters.setdefault(settings.replace(',', ', '), letter)}]"
    return Labels(short, {letter: settings for settings, letter in letters.items()})
