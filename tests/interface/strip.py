"""Takes out of a description by abidw what is the tool's or a foreign library's own, so that all versions of abidw and of
the compiler give the same: the insides of the classes of std and Eigen, whose size stays, and hashes.
Usage: strip.py FROM TO"""
import sys
from xml.etree import ElementTree

FOREIGN = ("std", "Eigen", "__gnu_cxx")
INSIDES = ("data-member", "member-function", "member-template", "base-class")


def strip(node, is_foreign):
    node.attrib.pop("hash", None)
    is_foreign = is_foreign or (node.tag == "namespace-decl" and node.get("name") in FOREIGN)
    for child in list(node):
        if is_foreign and node.tag == "class-decl" and child.tag in INSIDES:
            node.remove(child)
        else:
            strip(child, is_foreign)


tree = ElementTree.parse(sys.argv[1])
strip(tree.getroot(), False)
tree.write(sys.argv[2], encoding="unicode")
