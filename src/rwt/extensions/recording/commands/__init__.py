"""`rwt bag`: record, play, describe and repair recordings, with the verbs of `ros2 bag`."""

from __future__ import annotations

from typing import Final

from rwt.cli.parser import Commands, add_commands, add_unavailable

_UNAVAILABLE: Final = {
    "burst": "use `rwt bag play --start-paused`, then the right arrow key or /rosbag2_player/burst",
    "convert": "recordings are MCAP files, which other tools read; use `rosbags-convert` for other formats",
    "list": "there are no plugins: MCAP is written; MCAP, .bag and rosbag2 folders are read",
    "reindex": "MCAP files contain their index; use `rwt bag recover` to repair an incomplete one",
}


def add_bag_command(commands: Commands) -> None:
    """Add `bag` to the command line."""
    from rwt.extensions.recording.commands.play import add_play_verb
    from rwt.extensions.recording.commands.record import add_record_verb
    from rwt.extensions.recording.commands.recording import add_info_verb, add_recover_verb

    verbs = add_commands(commands.add_parser("bag", description=__doc__))
    add_record_verb(verbs)
    add_play_verb(verbs)
    add_info_verb(verbs)
    add_recover_verb(verbs)
    for name, why in _UNAVAILABLE.items():
        add_unavailable(verbs, name, why)
