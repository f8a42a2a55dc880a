import contextlib
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pieper.errors import RosError
from pieper.ros.names import LONGEST, Remap, check_namespace, check_node, full_node_name, resolve

tokens = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,8}", fullmatch=True)
namespaces = st.lists(tokens, max_size=3).map(lambda parts: "/" + "/".join(parts))
relative = st.lists(tokens, min_size=1, max_size=3).map("/".join)


@given(relative, namespaces, tokens)
def test_relative_private_and_absolute_names(name, namespace, node):
    def full(name):
        return resolve(name, namespace=namespace, node=node)

    above = "" if namespace == "/" else namespace
    assert full(name) == f"{above}/{name}"
    assert full(f"/{name}") == f"/{name}"
    assert full(f"~/{name}") == f"{above}/{node}/{name}"
    assert full("~") == full_node_name(namespace, node)
    assert full("{ns}/{node}/" + name) == full("{namespace}/{node}/" + name)
    assert full(full(name)) == full(name)


@pytest.mark.parametrize(
    ("name", "full"),
    [
        ("follow/_action/send_goal", "/cell2/follow/_action/send_goal"),
        ("double__underscore", "/cell2/double__underscore"),
        ("{node}/state", "/cell2/inverse/state"),
        ("/{node}/state", "/inverse/state"),
        ("~/{node}", "/cell2/inverse/inverse"),
    ],
)
def test_names_that_are_allowed(name, full):
    assert resolve(name, namespace="/cell2", node="inverse") == full


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("", "it is empty"),
        ("two words", "' ' is not allowed"),
        ("a-b", "'-' is not allowed"),
        ("ends/", "it ends with a slash"),
        ("/", "it ends with a slash"),
        ("a//b", "two slashes in a row"),
        ("a/2b", "'2b' begins with a digit"),
        ("~state", "after ~ comes a slash, as in '~/state'"),
        ("a~b", "'~' is not allowed"),
        ("{robot}/state", "{robot} stands for nothing; known are {node}, {ns} and {namespace}"),
        ("{node", "'{' is not allowed"),
        ("ünder", "'ü' is not allowed"),
        ("a" * LONGEST, f"at most {LONGEST} are allowed"),
    ],
)
def test_what_is_not_a_name(name, reason):
    with pytest.raises(RosError, match=re.escape(reason)):
        resolve(name, namespace="/cell2", node="inverse")


@given(st.text(max_size=20))
def test_any_text_is_a_name_or_an_error(text):
    with contextlib.suppress(RosError):
        full = resolve(text, namespace="/cell2", node="inverse")
        assert re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", full)


@pytest.mark.parametrize("name", ["", "2nd", "a/b", "a b", "a" * 256])
def test_what_is_not_the_name_of_a_node(name):
    with pytest.raises(RosError, match="is not the name of a node"):
        check_node(name)


def test_namespaces():
    check_namespace("/")
    check_namespace("/cell2/left")
    with pytest.raises(RosError, match="must begin with a slash, as in '/cell2'"):
        check_namespace("cell2")
    with pytest.raises(RosError, match="is not a namespace: it ends with a slash"):
        check_namespace("/cell2/")


def remapped(name, *rules):
    return resolve(name, namespace="/cell2", node="inverse", remaps=[Remap.parse(rule) for rule in rules])


@pytest.mark.parametrize(
    ("rule", "name", "full"),
    [
        ("target:=goal", "target", "/cell2/goal"),
        ("target:=goal", "/cell2/target", "/cell2/goal"),  # the rule is about the full name, however it is written
        ("target:=goal", "/target", "/target"),
        ("/cell2/target:=/goal", "target", "/goal"),
        ("~/state:=state", "~/state", "/cell2/state"),
        ("~/state:=state", "inverse/state", "/cell2/state"),
        ("target:=~/target", "target", "/cell2/inverse/target"),
        ("inverse:target:=goal", "target", "/cell2/goal"),
        ("forward:target:=goal", "target", "/cell2/target"),
        ("target:=/{node}/goal", "target", "/inverse/goal"),
    ],
)
def test_rules_of_remapping(rule, name, full):
    assert remapped(name, rule) == full


def test_the_first_rule_wins_and_its_target_is_not_remapped_again():
    assert remapped("a", "a:=b", "a:=c", "b:=d") == "/cell2/b"


@pytest.mark.parametrize(
    ("rule", "reason"),
    [
        ("target", "written 'from:=to'"),
        (":=goal", "written 'from:=to'"),
        ("target:=", "written 'from:=to'"),
        (":target:=goal", "written 'from:=to'"),
        ("a b:=goal", "' ' is not allowed"),
        ("target:=a b", "' ' is not allowed"),
        ("__ns:=cell2", "must begin with a slash"),
        ("__node:=a/b", "is not the name of a node"),
        ("__domain:=3", "'__domain' cannot be remapped"),
        ("a b:target:=goal", "is not the name of a node"),
        ("rostopic://target:=goal", "is for rostopic:// alone"),
    ],
)
def test_what_is_not_a_rule(rule, reason):
    with pytest.raises(RosError, match=re.escape(reason)):
        Remap.parse(rule)
