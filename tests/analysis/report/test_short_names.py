"""Short labels of long configurations: the study's own names first, and never one for two estimators."""

from cooploc.analysis.report.result_tables import LONGEST, short_names

LONG = "mrsl-rssi[density=exact,M=1,K=3]"


def test_a_configuration_has_the_name_that_the_study_gave_it_in_whatever_order_it_is_written():
    names = short_names([LONG], {"consistent": "K=3, density=exact,M=1"})
    assert names.of(LONG) == "mrsl-rssi[consistent]"


def test_other_long_labels_get_a_number_and_short_ones_stay():
    names = short_names(["arl", "arl[K=1]", LONG, LONG.replace("K=3", "K=2")], {})
    assert len("arl[K=1]") <= LONGEST < len(LONG)
    assert names.of("arl[K=1]") == "arl[K=1]"
    assert names.of(LONG) == "mrsl-rssi[#1]"
    assert names.of(LONG.replace("K=3", "K=2")) == "mrsl-rssi[#2]"


def test_the_configuration_that_is_its_methods_best_is_called_so():
    names = short_names(["arl[density=exact,M=1,K=1]", "arl[density=exact,M=1,K=2]"], {})
    assert names.of("arl[density=exact,M=1,K=1]") == "arl[best]"
    assert names.of("arl[density=exact,M=1,K=2]") == "arl[#2]"


def test_two_estimators_never_share_a_label():
    labels = ["ekf[raw]", "ekf[anchor_reading=rssi]", "ekf[ anchor_reading=rssi ]"]
    names = short_names(labels, {"raw": "anchor_reading=rssi"})
    assert len({names.of(label) for label in labels}) == 3


def test_labels_within_a_sentence_are_replaced_longest_first():
    labels = [LONG, LONG.replace("K=3", "K=30")]
    names = short_names(labels, {})
    assert names.within(f"{labels[1]} ties with {labels[0]}.") == "mrsl-rssi[#2] ties with mrsl-rssi[#1]."
