"""The small arena of most tests: as a configuration, and as flags."""

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig

_ARENA = {"size": 15, "dump_size": 3, "dust_area_size": 3, "dust_area_offset": 5, "n_dust": 24}
SMALL = SwarmConfig(arena=ArenaConfig(**_ARENA))
"""15 x 15 rd, a dump of 3 x 3 rd, 24 balls in two areas of 3 x 3 rd."""
FLAGS = [f"--arena.{name.replace('_', '-')}={value}" for name, value in _ARENA.items()]
