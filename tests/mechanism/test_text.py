"""Mechanisms as JSON come back equal; other texts are refused with the reason."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pcm_gym.mechanism import Rod, get_mechanism, mechanism_from_json, mechanism_names, mechanism_to_json
from tests.reference.mechanisms import FAMILIES, random_mechanism


@pytest.mark.parametrize("name", mechanism_names())
def test_a_catalogued_mechanism_comes_back_equal(name):
    mechanism = get_mechanism(name)
    again = mechanism_from_json(mechanism_to_json(mechanism))
    assert again == mechanism
    assert again.description == mechanism.description


@pytest.mark.parametrize("family", FAMILIES)
def test_random_numbers_come_back_to_the_last_digit(family):
    mechanism = random_mechanism(family, np.random.default_rng(5))
    assert mechanism_from_json(mechanism_to_json(mechanism)) == mechanism


def _without_rods(content):
    del content["legs"][0]["rod"]


def _with_unknown_actuator(content):
    content["legs"][1]["actuator"]["kind"] = "screw"


def _with_negative_length(content):
    content["legs"][0]["rod"]["length"] = -1.0


def _with_unknown_entry(content):
    content["colour"] = "red"


@pytest.mark.parametrize("damage", [_without_rods, _with_unknown_actuator, _with_negative_length, _with_unknown_entry])
def test_a_damaged_description_is_refused(damage):
    content = json.loads(mechanism_to_json(get_mechanism("2RFR")))
    damage(content)
    with pytest.raises(ValueError, match="does not describe a mechanism"):
        mechanism_from_json(json.dumps(content))


@pytest.mark.parametrize("text", ["", "[]", "{", "3", '{"legs": 2}'])
def test_other_texts_are_refused(text):
    with pytest.raises(ValueError, match="does not describe a mechanism"):
        mechanism_from_json(text)


def test_a_reference_rod_comes_back():
    mechanism = replace(get_mechanism("3PFR"), reference=Rod(2.0, 0.5))
    again = mechanism_from_json(mechanism_to_json(mechanism))
    assert again == mechanism
    assert again.units.length == 2.0
