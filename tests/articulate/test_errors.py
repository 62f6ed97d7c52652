import pytest

from articulate import errors
from articulate.errors import ArticulateError, UsageError, nearest


def test_nearest_names_the_word_that_was_meant():
    assert nearest("drawr", ["door", "drawer"]) == "; did you mean drawer?"


def test_nearest_lists_what_exists_when_nothing_is_close():
    assert nearest("xyz", ["b", "a"]) == "; known: a, b"


def test_nearest_says_nothing_when_nothing_exists():
    assert nearest("xyz", []) == ""


@pytest.mark.parametrize(
    "name", ["ConfigError", "AssetError", "ReachError", "RunError", "BundleError", "MissingError"]
)
def test_bad_input_is_one_family(name):
    assert issubclass(getattr(errors, name), UsageError)


def test_divergence_is_no_bad_input():
    assert issubclass(errors.DivergedError, ArticulateError)
    assert not issubclass(errors.DivergedError, UsageError)


def test_every_error_stands_in_the_tree_of_the_module():
    classes = [c for c in vars(errors).values() if isinstance(c, type) and issubclass(c, Exception)]
    assert len(classes) >= 9
    for cls in classes:
        assert cls.__name__ in errors.__doc__
