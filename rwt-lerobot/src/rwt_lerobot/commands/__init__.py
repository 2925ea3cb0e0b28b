"""The command `rwt lerobot`: a MuJoCo model, or a robot of LeRobot, for rosbridge clients; datasets."""

from __future__ import annotations

from rwt.cli.parser import Commands, add_commands
from rwt_lerobot.commands.convert import add_convert_verb
from rwt_lerobot.commands.mujoco import add_mujoco_verb
from rwt_lerobot.commands.serve import add_serve_verb


def add_lerobot_command(commands: Commands) -> None:
    """Add `lerobot` to the command line."""
    verbs = add_commands(commands.add_parser("lerobot", description=__doc__))
    add_mujoco_verb(verbs)
    add_serve_verb(verbs)
    add_convert_verb(verbs)
