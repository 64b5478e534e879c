"""What was checked once is not checked again in another run's folder, as long as nothing that it depends on changed."""

import json

import pytest

from cooploc.analysis.execution import certificates, shared_certificates
from cooploc.analysis.execution.certificates import StudyWorlds, World, renewed
from cooploc.estimators import configure
from cooploc.scenarios import resolve

PLAIN = """
class Still:
    uses = ("odometry",)
    def __init__(self, prior, world, robot, key): self.x, self.P = prior
    def predict(self, z): pass
    def correct(self, z): pass
"""
PASSED = {"check": "runs", "status": "passed", "detail": "it ran", "seed": 0}


@pytest.fixture
def checks(tmp_path, monkeypatch):
    """A plug-in in a folder, a cache, and the labels that were really checked."""
    made = []

    def certify(label, limit=0.0, worlds=None):
        made.append(label)
        return {"status": "passed", "found": "1 checks", "checks": [PASSED]}

    (tmp_path / "plain.py").write_text(PLAIN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COOPLOC_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(certificates, "certify", certify)
    return made


def certificate(label="plain.py:Still", scenario="robots-1-3/n=2", seed=1, said=None):
    """The certificate that a run in a new folder gets."""
    worlds = StudyWorlds((World(resolve(scenario), 5),), seed)
    told = [] if said is None else said
    ((_, found),) = renewed([configure(label)], {}, True, told.append, worlds=lambda _: worlds)
    return found


def test_another_run_of_the_same_worlds_takes_the_certificate(checks):
    first, said = certificate(), []
    assert certificate(said=said) == first
    assert checks == ["plain.py:Still"]
    assert said == ["plain.py:Still: ✓ 1 checks, as in another run; its file and this study's worlds are the same"]


@pytest.mark.parametrize("change", [{"scenario": "robots-1-3/n=3"}, {"scenario": "nlos"}, {"seed": 2}])
def test_other_worlds_or_another_seed_need_another_certificate(checks, change):
    certificate()
    certificate(**change)
    assert len(checks) == 2


def test_an_edited_file_or_a_copy_of_it_elsewhere_is_checked_again(checks, tmp_path):
    certificate()
    (tmp_path / "copy.py").write_text(PLAIN)
    certificate("copy.py:Still")
    (tmp_path / "plain.py").write_text(PLAIN + "# edited\n")
    certificate()
    assert checks == ["plain.py:Still", "copy.py:Still", "plain.py:Still"]


def test_other_versions_of_cooploc_or_of_what_is_imported_do_not_share(checks, monkeypatch):
    certificate()
    monkeypatch.setattr(shared_certificates, "bits", lambda: {"source": "another"})
    certificate()
    assert len(checks) == 2
    one = shared_certificates.key("a", {"a.py": "0", "jax": "1"}, [])
    assert one != shared_certificates.key("a", {"a.py": "0", "jax": "2"}, [])


def test_a_file_that_it_read_and_that_changed_spoils_it(checks, tmp_path):
    certificate()
    (file,) = (tmp_path / "cache" / "certificates").iterdir()
    held = json.loads(file.read_text())
    (tmp_path / "table.txt").write_text("edited meanwhile")
    inputs = {str(tmp_path / "table.txt"): "0" * 64}
    del held["checksum"]
    held["certificate"]["inputs"] = inputs
    file.write_text(json.dumps(shared_certificates.seal(held)))
    certificate()
    assert len(checks) == 2


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda text: text[:50], "it is not JSON"),
        (lambda text: text.replace("passed", "failed"), "does not match its checksum"),
        (
            lambda text: json.dumps(shared_certificates.seal({"format": 2, "key": "0" * 64})),
            "estimator: Field required",
        ),
        (lambda text: json.dumps({**json.loads(text), "format": 99}), "format 99, this version reads up to 2"),
    ],
)
def test_a_damaged_or_foreign_file_is_ignored_in_one_line_and_made_again(checks, tmp_path, write, words):
    first = certificate()
    (file,) = (tmp_path / "cache" / "certificates").iterdir()
    file.write_text(write(file.read_text()))
    said = []
    assert certificate(said=said) == first
    assert len(checks) == 2
    assert said[0].startswith(f"the certificate {file} is ignored (")
    assert words in said[0]
    assert "\n" not in said[0]
    certificate()
    assert len(checks) == 2  # it is whole again


def test_a_certificate_of_something_else_is_not_taken(checks, tmp_path):
    certificate()
    (file,) = (tmp_path / "cache" / "certificates").iterdir()
    certificate(seed=2)
    (other,) = set((tmp_path / "cache" / "certificates").iterdir()) - {file}
    other.write_text(file.read_text())
    said = []
    certificate(seed=2, said=said)
    assert "it is of something else" in said[0]


def test_nothing_is_shared_where_the_variable_is_set_to_nothing(checks, monkeypatch):
    monkeypatch.setenv("COOPLOC_CACHE", "")
    certificate()
    certificate()
    assert len(checks) == 2
    monkeypatch.delenv("COOPLOC_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert shared_certificates.folder().as_posix() == "/somewhere/cooploc/certificates"


def test_a_cache_that_cannot_be_written_costs_one_line(checks, tmp_path):
    (tmp_path / "cache").write_text("a file, not a folder")
    said = []
    certificate(said=said)
    assert said[-1].startswith("the certificate of plain.py:Still is not kept for other runs (")
    assert "set COOPLOC_CACHE" in said[-1]


def test_what_was_ended_before_it_had_a_result_is_not_kept(checks, tmp_path):
    shared_certificates.keep("0" * 64, "plain.py:Still", {"status": "unchecked", "found": "", "checks": []}, print)
    assert not (tmp_path / "cache").exists()
