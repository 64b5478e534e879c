"""Draw three of the worlds side by side, each in one trial.

python examples/worlds.py worlds.png
"""

import sys

import matplotlib.pyplot as plt

import cooploc as cl

WORLDS = {
    "nlos": "three robots, walls and moving obstacles",
    "packet-drop/drop=0.7": "five robots, 70 % of the packets lost",
    "body-blocking/n=10": "ten robots that stand in each other's way",
}

figure, axes = plt.subplots(1, 3, figsize=(11, 4.4), sharey=True)
for ax, (label, about) in zip(axes, WORLDS.items(), strict=True):
    cl.plot.world(label, tick=60, ax=ax)
    ax.set_title(about, loc="left", fontsize=10)
    ax.get_legend().remove()
    ax.label_outer()
figure.tight_layout()
keys = {label: mark for ax in axes for mark, label in zip(*ax.get_legend_handles_labels(), strict=True)}
shown = {label: mark for label, mark in keys.items() if not label.startswith("robot")}
below = {"loc": "lower center", "bbox_to_anchor": (0.5, -0.06), "ncols": len(shown), "frameon": False}
figure.legend([*shown.values()], [*shown], **below)
figure.savefig(sys.argv[1], dpi=120, bbox_inches="tight")
