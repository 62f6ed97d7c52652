import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from articulate.config import (
    from_mapping,
    known_keys,
    load_config,
    number_of,
    preset_folder,
    preset_names,
    preset_path,
    read_yaml,
    to_yaml,
)
from articulate.errors import ConfigError

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, kw_only=True)
class Ppo:
    learning_rate: float = 1e-3
    horizon: int = 100
    clip: float | None = None


@dataclass(frozen=True, kw_only=True)
class Config:
    name: str = "run"
    asset: Path = Path("cabinet.urdf")
    task: Literal["open_drawer", "open_joint"] = "open_drawer"
    ppo: Ppo = Ppo()
    second: Ppo | None = None
    seeds: tuple[int, ...] = (0,)
    size_m: tuple[float, float] | None = None
    weights: dict[str, float] | None = None
    parts: tuple[Ppo, ...] = ()
    mixed: float | str = "auto"
    fast: bool = False

    def __post_init__(self) -> None:
        if len(self.seeds) > 9:
            raise ConfigError(f"seeds are {len(self.seeds)}; at most 9 are accepted")


@dataclass(frozen=True, kw_only=True)
class Required:
    asset: Path
    ppo: Ppo = Ppo()


NUMBERS = st.floats(allow_nan=False)
TEXTS = st.text(st.characters(exclude_categories=["Cs"]))
PPOS = st.builds(
    Ppo, learning_rate=NUMBERS, horizon=st.integers(-(2**70), 2**70), clip=st.none() | NUMBERS
)
CONFIGS = st.builds(
    Config,
    name=TEXTS,
    asset=TEXTS.map(Path),
    task=st.sampled_from(["open_drawer", "open_joint"]),
    ppo=PPOS,
    second=st.none() | PPOS,
    seeds=st.lists(st.integers(), max_size=9).map(tuple),
    size_m=st.none() | st.tuples(NUMBERS, NUMBERS),
    weights=st.none() | st.dictionaries(TEXTS, NUMBERS),
    parts=st.lists(PPOS, max_size=3).map(tuple),
    mixed=NUMBERS | TEXTS,
    fast=st.booleans(),
)


@given(CONFIGS)
def test_yaml_of_a_config_reads_back_as_an_equal_one(config):
    assert from_mapping(Config, yaml.safe_load(to_yaml(config)), "text") == config


def test_file_lies_over_defaults_and_overrides_over_the_file(tmp_path):
    path = tmp_path / "fast.yaml"
    path.write_text("ppo: {horizon: 7, learning_rate: 1e-4}\nseeds: [3]\n")
    config = load_config(Config, path, {"ppo.horizon": 9, "fast": True})
    assert config == Config(ppo=Ppo(horizon=9, learning_rate=1e-4), seeds=(3,), fast=True)


def test_nothing_given_is_the_default():
    assert load_config(Config) == Config()


def test_base_keeps_what_the_mapping_leaves_out():
    base = Config(ppo=Ppo(horizon=5, learning_rate=0.5), seeds=(1, 2))
    config = from_mapping(Config, {"ppo": {"horizon": 6}}, "text", base=base)
    assert config == Config(ppo=Ppo(horizon=6, learning_rate=0.5), seeds=(1, 2))


@pytest.mark.parametrize(("text", "value"), [("2e6", 2_000_000), ("2.0e+6", 2_000_000), ("5", 5)])
def test_whole_numbers_may_be_written_with_an_exponent(text, value):
    horizon = from_mapping(Config, yaml.safe_load(f"ppo: {{horizon: {text}}}"), "text").ppo.horizon
    assert horizon == value
    assert type(horizon) is int


def test_text_that_looks_like_a_number_stays_text_where_both_are_accepted():
    assert from_mapping(Config, {"mixed": "1.5"}, "text").mixed == "1.5"
    assert from_mapping(Config, {"mixed": 2}, "text").mixed == 2.0


def test_unknown_keys_are_answered_with_the_nearest(error_line):
    def load(**content):
        return lambda: from_mapping(Config, content, "configs/fast.yaml")

    where = "'configs/fast.yaml'"
    error_line(
        f"from_mapping(Config, {{'ppo': {{'lerning_rate': 1}}}}, {where})",
        load(ppo={"lerning_rate": 1}),
    )
    error_line(f"from_mapping(Config, {{'horizon': 1}}, {where})", load(horizon=1))
    error_line(f"from_mapping(Config, {{'ppo': {{'xyz': 1}}}}, {where})", load(ppo={"xyz": 1}))
    error_line(
        f"from_mapping(Config, {{'second': {{'horizn': 1}}}}, {where})", load(second={"horizn": 1})
    )


@pytest.mark.parametrize(
    "content",
    [
        {"ppo": {"horizon": 1.5}},
        {"ppo": {"horizon": True}},
        {"ppo": {"learning_rate": "fast"}},
        {"ppo": {"learning_rate": None}},
        {"ppo": 3},
        {"fast": "yes"},
        {"fast": 1},
        {"name": 5},
        {"asset": 5},
        {"task": "open_drawr"},
        {"task": 1},
        {"seeds": 3},
        {"seeds": [0, "a"]},
        {"size_m": [1.0]},
        {"weights": [1.0]},
        {"weights": {"a": "b"}},
        {"mixed": [1]},
        {"seeds": list(range(10))},
    ],
    ids=str,
)
def test_values_that_are_not_accepted_are_named_with_their_key(content, error_line):
    call = f"from_mapping(Config, {content}, 'configs/fast.yaml')"
    line = error_line(call, lambda: from_mapping(Config, content, "configs/fast.yaml"))
    assert line.startswith("configs/fast.yaml: ")


def test_not_a_number_is_refused():
    with pytest.raises(ConfigError, match="must be a number"):
        from_mapping(Config, {"ppo": {"learning_rate": math.nan}}, "text")


def test_missing_key_is_named(error_line):
    error_line(
        "from_mapping(Required, {}, 'run.yaml')", lambda: from_mapping(Required, {}, "run.yaml")
    )


@pytest.mark.parametrize(
    "text",
    [
        "[1, 2]",
        "a: [1",
        "a: 1\na: 2",
        "a: !!python/object:os.system {}",
        "just words",
        "a: \x00",
        "[a]: 1",
        "a: 2024-13-45",
    ],
    ids=repr,
)
def test_files_that_hold_no_mapping_are_refused(text, tmp_path, error_line):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    error_line(f"read_yaml(Path('bad.yaml'))  # {text!r}", lambda: read_yaml(path))


@pytest.fixture
def presets(tmp_path, monkeypatch):
    """Presets ``quickstart`` and ``default``, whatever the project has."""
    folder = tmp_path / "presets"
    folder.mkdir()
    for name in ["quickstart", "default"]:
        (folder / f"{name}.yaml").write_text(f"name: {name}\n")
    monkeypatch.setattr("articulate.config.preset_folder", lambda: folder)


@pytest.mark.usefixtures("presets")
def test_preset_is_loaded_by_its_name():
    assert load_config(Config, "quickstart").name == "quickstart"


@pytest.mark.usefixtures("presets")
def test_files_that_cannot_be_read_are_refused(tmp_path, error_line):
    error_line("load_config(Config, 'quikstart')", lambda: load_config(Config, "quikstart"))
    error_line("load_config(Config, 'absent')", lambda: load_config(Config, "absent"))
    error_line("load_config(Config, 'a/absent.yaml')", lambda: load_config(Config, "a/absent.yaml"))
    (tmp_path / "latin.yaml").write_bytes(b"name: \xe9")
    error_line("read_yaml(Path('latin.yaml'))", lambda: read_yaml(tmp_path / "latin.yaml"))


def test_empty_file_is_an_empty_mapping(tmp_path):
    (tmp_path / "empty.yaml").write_text("# nothing\n")
    assert load_config(Config, tmp_path / "empty.yaml") == Config()


def test_known_keys_go_into_nested_and_optional_dataclasses():
    keys = list(known_keys(Config))
    assert "ppo.learning_rate" in keys
    assert "second.clip" in keys
    assert keys[0] == "name"


def test_presets_of_the_checkout_are_found_by_name():
    assert preset_folder() == ROOT / "configs"
    for name in preset_names():
        assert preset_path(name) == ROOT / "configs" / f"{name}.yaml"


def test_brackets_too_deep_are_refused(tmp_path):
    path = tmp_path / "deep.yaml"
    path.write_text("a: " + "[" * 5000 + "]" * 5000)
    with pytest.raises(ConfigError, match="not YAML"):
        read_yaml(path)


def test_whole_numbers_keep_all_their_digits():
    assert number_of(int, "9007199254740993") == 9007199254740993
    assert number_of(int, "2e6") == 2_000_000
    assert number_of(int, "2.5") is None
