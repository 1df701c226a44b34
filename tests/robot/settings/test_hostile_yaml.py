"""YAML that people wrote by hand, or that was made to do harm: one line, at once, and nothing is read as what it does not say."""

import time
from contextlib import suppress

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.errors import ConfigError, PanolocError
from panoloc_mcl.robot.settings.validation import dump_yaml, parse_yaml

_TEXT = st.text(st.characters(min_codepoint=32, max_codepoint=126))
BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 10)}]\n" for level in range(1, 12)
)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("010", 10),
        ("02000", 2000),
        ("-007", -7),
        ("1:30", "1:30"),
        ("1:30.5", "1:30.5"),
        ("0o17", "0o17"),
        ("0x1F", 31),
        ("1_000", 1000),
        ("1.5", 1.5),
        ("-.5e+3", "-.5e+3"),
        (".inf", float("inf")),
    ],
)
def test_numbers_are_those_of_yaml_1_2(text, value):
    found = parse_yaml(f"a: {text}", "f")["a"]
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<<: {a: 1}", "merge keys"),
        ("a: &x {b: 1}\nc: {<<: *x}", "merge keys"),
        ("a: " + "[" * 3000, "levels deep"),
        ("a: " + "[" * 3000 + "]" * 3000, "levels deep"),
        ("- " * 3000 + "x", "levels deep"),
        ("".join("  " * level + "a:\n" for level in range(300)), "levels deep"),
        (BOMB, "aliases counted as what they stand for"),
        ("observation: &a {votes: *a}", "stands inside what it names"),
        ("a: 2001-13-45", "month"),
        ("a: " + "9" * 5000, "digits"),
        ("a: [" + "1," * 30_000 + "1]", "more than 20000 values"),
        ("a: " + "x" * 5_000_000, "characters"),
        ("a: *nowhere", "undefined alias"),
        ("a: !!python/object/apply:os.system [ls]", "constructor"),
        ("a: \x00", "special characters"),
    ],
)
def test_what_would_do_harm_is_one_line_at_once(text, words):
    begin = time.perf_counter()
    with pytest.raises(ConfigError, match=words) as caught:
        parse_yaml(text, "run.yaml")
    assert time.perf_counter() - begin < 10.0
    (fault,) = caught.value.faults
    assert fault.startswith("run.yaml")
    assert len(fault) < 400


def test_a_few_aliases_are_welcome():
    assert parse_yaml("a: &x [1, 2]\nb: *x\nc: *x", "f") == {"a": [1, 2], "b": [1, 2], "c": [1, 2]}


@given(st.dictionaries(_TEXT, st.one_of(st.integers(), st.floats(allow_nan=False), _TEXT, st.booleans(), st.none())))
@example({"<<": None})
@settings(max_examples=300, deadline=None)
def test_what_is_written_reads_the_same(data):
    assert parse_yaml(dump_yaml(data), "f") == data


@given(st.text(alphabet=st.sampled_from(list("a1:-[]{}&*!<>|'\"#%@ \n\t.,?0x_=~\\")), max_size=60))
@settings(max_examples=1000, deadline=None)
def test_any_text_is_yaml_or_a_known_error(text):
    with suppress(PanolocError):
        parse_yaml(text, "f")
