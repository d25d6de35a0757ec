# SPDX-License-Identifier: Apache-2.0
"""./seed access: keys and least-privilege permissions of every node of a cell, for SROS 2."""

from pathlib import Path

from seed_bringup.access.keystore import make_keystore
from seed_bringup.access.policy import read_policy
from seed_bringup.commands.cells import namespace_argument
from seed_bringup.launching.packages import package_share
from seed_core.errors import SeedError
from seed_core.program.command_line import Parser, command

NAMESPACE = "namespace"  # file in the keystore: whose cell's it is


def check_namespace(folder: Path, namespace: str) -> None:
    """Raise SeedError where a keystore is another cell's: enclaves have the same paths in each."""
    file = folder / NAMESPACE
    if file.is_file() and (there := file.read_text(encoding="utf-8").strip()) != namespace:
        of = f"the cell in namespace '{there}'" if there else "a cell without a namespace"
        raise SeedError(f"{folder} has the keys of {of}: name another folder, or delete {file} to turn it over")


@command("seed access")
def main(argv: list[str]) -> int:
    """Make the keystore."""
    p = Parser(prog="seed access", description=__doc__)
    p.add_argument("keystore", type=Path, metavar="FOLDER", help="the keystore, made or brought up to date")
    p.add_argument("--policy", type=Path, metavar="FILE", help="other rights than those of the suite's cell.policy.xml")
    namespace_argument(p)
    options = p.parse_args(argv)
    policy = options.policy or package_share("seed_bringup") / "config" / "access" / "cell.policy.xml"
    rights = read_policy(policy, options.namespace)
    folder = options.keystore.resolve()
    check_namespace(folder, options.namespace)
    make_keystore(folder, rights)
    (folder / NAMESPACE).write_text(f"{options.namespace}\n", encoding="utf-8")
    print(f"enclaves {', '.join(rights)} in {folder}")
    print(f"export ROS_SECURITY_KEYSTORE={folder} ROS_SECURITY_ENABLE=true ROS_SECURITY_STRATEGY=Enforce")
    print("then launch the cell there; for commands: export ROS_SECURITY_ENCLAVE_OVERRIDE=/operator")
    print(f"{folder / 'private'} signs new rights: keep it where the robot's computers are not")
    return 0
