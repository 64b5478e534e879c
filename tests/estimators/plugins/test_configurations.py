"""Which configuration of a method has which name."""

import pytest

from cooploc.estimators import make
from cooploc.estimators.listing import KNOWN, setting_kind


def test_every_configuration_can_be_made_and_is_of_its_method():
    for name, both in KNOWN.items():
        published, best = map(make, both)
        assert published != best
        assert {label.partition("[")[0] for label in both} == {name}


@pytest.mark.parametrize(
    ("label", "expected"),
    [
        ("arl[K=1,M=1.0,density=exact]", "at its best"),
        ("arl[particles=200]", "preset"),  # the default
        ("arl[particles=500]", ""),
        ("ctrn[weights=exact]", "preset"),  # by whichever solver
        ("ctrn[weights=exact,fusion=received]", ""),
        ("ekf-joint", ""),  # has only one
        ("arl[nothing=1]", ""),
    ],
)
def test_a_label_is_recognised_by_what_it_makes(label, expected):
    assert setting_kind(label) == expected
