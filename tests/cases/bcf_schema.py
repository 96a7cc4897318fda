"""Checks BCF files against buildingSMART's schemas, by the classes that bcf-client made of them."""

import dataclasses
import re
import types
import typing
from xml.etree import ElementTree

import numpy as np
import pytest

NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")  # of xs:double, without INF and NaN


def check_schema(content, version="3.0"):
    """Every file of an archive against buildingSMART's schemas, as bcf-client carries them."""
    model = pytest.importorskip(f"bcf.v{version[0]}.model")
    kinds = {
        "bcf.version": model.Version, "markup.bcf": model.Markup, "viewpoint.bcfv": model.VisualizationInfo,
        **(
            {"project.bcfp": model.ProjectInfo, "extensions.xml": model.Extensions}
            if version == "3.0"
            else {"project.bcfp": model.ProjectExtension}
        ),
    }  # fmt: skip
    words = {"3.0": "extensions.xml", "2.1": "extensions.xsd"}[version]
    assert {"bcf.version", "project.bcfp", words} <= content.keys()
    for name, data in content.items():
        short = name.rpartition("/")[2]
        if short in kinds:
            root = ElementTree.fromstring(data)
            assert root.tag == kinds[short].__name__
            check_element(root, kinds[short])
            if short == "viewpoint.bcfv":  # a choice, which the classes cannot say
                assert sum(child.tag.endswith("Camera") for child in root) == 1
        else:
            assert short in ("", "snapshot.png", words), name


def check_element(element, kind):
    """Names, order, counts and values of an element's attributes and children are those that its class asks for."""
    hints = typing.get_type_hints(kind)
    fields = {name: [] for name in ("Attribute", "Element")}
    for field in dataclasses.fields(kind):
        fields[field.metadata["type"]].append(field)
    assert not (element.text or "").strip(), f"{element.tag}: text between elements"
    assert element.attrib.keys() <= {field.metadata["name"] for field in fields["Attribute"]}, element.tag
    for field in fields["Attribute"]:
        if (value := element.get(field.metadata["name"])) is not None:
            check_value(value, hints[field.name], field.metadata)
        else:
            assert not field.metadata.get("required"), f"{element.tag}: {field.name} is missing"
    children = list(element)
    for field in fields["Element"]:
        count = 0
        while children and children[0].tag == field.metadata["name"]:
            child, inner = children.pop(0), plain_type(hints[field.name])
            assert not (child.tail or "").strip(), f"{child.tag}: text after it"
            if dataclasses.is_dataclass(inner):
                check_element(child, inner)
            else:
                assert not len(child) and not child.attrib
                check_value(child.text or "", inner, field.metadata)
            count += 1
        many = typing.get_origin(hints[field.name]) is list
        least = field.metadata.get("min_occurs", 0) if many else bool(field.metadata.get("required"))
        assert least <= count <= (count if many else 1), f"{element.tag}: {count} of {field.name}"
    assert not children, f"{element.tag}: {children[0].tag} is not known, or not here"


def plain_type(hint):
    """X of X, X | None and list[X]."""
    if typing.get_origin(hint) in (typing.Union, types.UnionType, list):
        return next(one for one in typing.get_args(hint) if one is not type(None))
    return hint


def check_value(text, kind, rules):
    kind = plain_type(kind)
    if rules.get("white_space") == "collapse":
        text = " ".join(text.split())
    if kind is float:
        assert NUMBER.fullmatch(text), text
        assert rules.get("min_exclusive", -np.inf) < float(text) < rules.get("max_exclusive", np.inf)
    elif kind is int:
        assert re.fullmatch(r"[+-]?\d+", text), text
    elif kind is bool:
        assert text in ("true", "false", "0", "1"), text
    elif kind is not str:
        kind.from_string(text)
    assert len(text) >= rules.get("min_length", 0)
    assert rules.get("length") in (None, len(text))
    assert re.fullmatch(rules.get("pattern", ".*"), text, re.DOTALL), text
