#!/usr/bin/env python3
"""Cuts measured models down to the figures that the tests compare.

    scripts/trim_models.py FROM TO SCENE...

Every FROM/<SCENE>.json becomes TO/<SCENE>.json with the figures that move bodies; colours, groups and
derived statistics are left out.
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
    "actuators": ["target", "gear", "ctrllimited", "ctrlrange", "forcelimited", "gainprm", "biasprm"],
}
OPTIONS = ["timestep", "integrator", "solver", "iterations", "tolerance", "cone", "jacobian", "impratio",
           "density", "viscosity", "gravity", "collision", "disableflags", "enableflags"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("source", type=pathlib.Path, metavar="FROM")
    parser.add_argument("target", type=pathlib.Path, metavar="TO")
    parser.add_argument("scenes", nargs="+", metavar="SCENE")
    args = parser.parse_args()
    args.target.mkdir(parents=True, exist_ok=True)
    for scene in args.scenes:
        model = json.loads((args.source / f"{scene}.json").read_text())
        lines = [f' "measured_with": {json.dumps(model["measured_with"])}']
        lines.append(f' "option": {json.dumps({k: model["option"][k] for k in OPTIONS})}')
        lines.append(f' "meaninertia": {json.dumps(model["statistic"]["meaninertia"])}')
        lines.append(f' "qpos0": {json.dumps(model["qpos0"])}')
        lines.append(f' "qpos_spring": {json.dumps(model["qpos_spring"])}')
        for kind, keys in KEEP.items():
            entries = [json.dumps({k: entry[k] for k in keys}) for entry in model[kind]]
            lines.append(f' "{kind}": [\n  ' + ",\n  ".join(entries) + "\n ]" if entries else f' "{kind}": []')
        (args.target / f"{scene}.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main()
