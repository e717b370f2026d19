#!/usr/bin/env python3
"""Cuts measured models down to the figures that the tests compare.

    scripts/trim_models.py FROM TO SCENE...

Every FROM/<SCENE>.json becomes TO/<SCENE>.json with the figures that move bodies; colours, groups and
derived statistics are left out. Of the hand scenes only shapes that can touch something are kept, without
the dimensions of meshes, and pens get the inertia that the published tasks ran with.
"""

import argparse
import json
import pathlib

KEEP = {
    "bodies": ["name", "parent_id", "pos", "quat", "mass", "ipos", "iquat", "inertia"],
    "joints": ["name", "type", "body", "qposadr", "dofadr", "axis", "pos", "limited", "range", "margin",
               "stiffness", "solref_limit", "solimp_limit", "damping", "armature", "frictionloss",
               "dof_invweight0"],
    "geoms": ["type", "body", "size", "pos", "quat", "contype", "conaffinity", "condim", "priority",
              "friction", "margin", "gap", "solmix", "solref", "solimp"],
    "sites": ["name", "body", "pos"],
    "actuators": ["name", "target", "gear", "ctrllimited", "ctrlrange", "forcelimited", "forcerange", "gainprm",
                  "biasprm"],
    "tendons": ["name", "limited", "range", "margin", "stiffness", "damping", "frictionloss", "joints"],
    "contact_pairs": ["geom1", "geom2", "condim", "friction", "margin", "gap", "solref", "solimp"],
}
OPTIONS = ["timestep", "integrator", "solver", "iterations", "tolerance", "cone", "jacobian", "impratio",
           "density", "viscosity", "gravity", "collision", "disableflags", "enableflags"]


def as_published(model):
    """The hand scene `model` as the published tasks ran it, without what only is to be looked at."""
    pens = model.get("published_pen_inertial", {})
    for body in model["bodies"]:
        if body["name"] in pens:
            body["mass"] = pens[body["name"]]["mass"]
            body["inertia"] = pens[body["name"]]["diaginertia"]
    for joint in model["joints"]:
        if joint["body"] in pens:
            joint["dof_invweight0"] = pens[joint["body"]]["dof_invweight0"]
    model["statistic"]["meaninertia"] = model.get("published_pen_meaninertia", model["statistic"]["meaninertia"])
    model["geoms"] = [geom for geom in model["geoms"] if geom["contype"] | geom["conaffinity"]]
    for geom in model["geoms"]:
        if geom["type"] == "mesh":
            for key in ("size", "pos", "quat"):
                del geom[key]
    model["sites"] = [site for site in model["sites"] if site["name"] != "centre-point"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("source", type=pathlib.Path, metavar="FROM")
    parser.add_argument("target", type=pathlib.Path, metavar="TO")
    parser.add_argument("scenes", nargs="+", metavar="SCENE")
    args = parser.parse_args()
    args.target.mkdir(parents=True, exist_ok=True)
    for scene in args.scenes:
        model = json.loads((args.source / f"{scene}.json").read_text())
        if any(geom["name"].startswith("robot0:") for geom in model["geoms"] if geom["name"]):
            as_published(model)
        lines = [f' "measured_with": {json.dumps(model["measured_with"])}']
        lines.append(f' "option": {json.dumps({k: model["option"][k] for k in OPTIONS})}')
        lines.append(f' "meaninertia": {json.dumps(model["statistic"]["meaninertia"])}')
        lines.append(f' "qpos0": {json.dumps(model["qpos0"])}')
        lines.append(f' "qpos_spring": {json.dumps(model["qpos_spring"])}')
        for kind, keys in KEEP.items():
            entries = [json.dumps({k: entry[k] for k in keys if k in entry}) for entry in model[kind]]
            lines.append(f' "{kind}": [\n  ' + ",\n  ".join(entries) + "\n ]" if entries else f' "{kind}": []')
        (args.target / f"{scene}.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main()
