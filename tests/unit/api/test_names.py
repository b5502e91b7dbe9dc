"""Public names of the package: the commands' words, and those of the version before."""

import inspect
import warnings

import pytest
import yaml

import cldit
from cldit.errors import EvaluationError, RunFolderError

COMMANDS = ("fit", "plan", "sweep", "import_case", "export", "view", "compare", "evaluate")


def test_every_name_is_there() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in cldit.__all__:
            assert getattr(cldit, name) is not None
    assert set(COMMANDS) < set(dir(cldit))
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = cldit.simulat


@pytest.mark.parametrize("name", ["parse_scene", "dump_scene", "open_device", "run_experiment"])
def test_old_names_name_their_successor(name: str) -> None:
    with pytest.warns(DeprecationWarning, match=rf"cldit\.{name} is cldit\.\w+"):
        assert callable(getattr(cldit, name))


def test_public_functions_state_arguments_and_errors() -> None:
    """Args, and what is returned or raised, in the docstring of each function."""
    for name in cldit.__all__:
        public = getattr(cldit, name)
        if not inspect.isfunction(public) or not inspect.signature(public).parameters:
            continue
        text = inspect.getdoc(public) or ""
        assert "Args:" in text and ("Raises:" in text or "Returns:" in text), name


def test_scene_from_a_mapping_and_as_yaml() -> None:
    scene = cldit.load_scene("empty")
    assert cldit.Scene.from_dict(yaml.safe_load(scene.to_yaml())) == scene


def test_recording_needs_a_folder() -> None:
    with pytest.raises(EvaluationError, match=r"record=True: allowed: with `out`"):
        cldit.simulate("empty", record=True)
    with pytest.raises(EvaluationError, match=r"record=True"):
        cldit.simulate("empty", "there", record=True, like=object())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("error_K", "quantile", "text"),
    [(0.0, 0.9, "error_K: 0"), (1.0, 1.5, "quantile: 1.5")],
)
def test_a_plan_is_checked_before_it_traces(error_K: float, quantile: float, text: str) -> None:
    with pytest.raises(EvaluationError, match=text):
        cldit.plan("empty", error_K, quantile=quantile)


def test_a_view_needs_a_folder() -> None:
    with pytest.raises(RunFolderError, match="view: no folder"):
        cldit.view()
