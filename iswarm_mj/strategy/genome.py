"""Evolved parameters of a swarm, as the paper's Table 2 lists them."""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

from iswarm_mj.utils.constraints import Within, validate
from iswarm_mj.utils.errors import ConfigError, UserError, shown
from iswarm_mj.utils.files import read_json

Share = Annotated[float, Within(0, 1)]


@dataclass(frozen=True)
class Genome:
    """Parameters of a swarm's strategy; the defaults are type 1 of the paper's Table 2.

    Source: Valdastri et al. (2006), Table 2. The unit sr is the sensory radius, 3.5 rd. The paper
    prints p(vector-forget) of type 2 as "14%"; the text of section 4.6.1 says 0.14.
    """

    density_of_robots: Share = 0.118
    """Robots per 1 x 1 rd cell of the arena outside the dump."""
    fraction_scouts: Share = 0.08
    """Share of robots that are scouts."""
    p_vector_forget: Share = 0.29
    """Probability per step that a robot forgets the vectors in its memory."""
    use_hop_count: bool = True
    """A robot adopts a vector only if its hop count is smaller than its own."""
    priority_coll_avoid_dist: Share = 0.40
    """Distance that empty robots keep from robots that send the priority flag [sr]."""
    empty_coll_avoid_dist: Share = 0.65
    """Distance that empty robots keep from other robots [sr]."""
    loaded_coll_avoid_dist: Share = 0.25
    """Distance that loaded robots keep from any robot [sr]."""
    priority_signal_scouts: bool = False
    """Scouts send the priority flag."""
    priority_signal_loaded: bool = True
    """Loaded robots send the priority flag."""
    weight_find_dust: Share = 0.83
    """Probability per step that an empty robot follows its vector to dust."""
    weight_find_dump: Share = 0.94
    """Probability per step that a loaded robot follows its vector to the dump."""

    def __post_init__(self):
        validate(self)


TYPE1 = Genome()
TYPE2 = Genome(
    density_of_robots=0.132,
    fraction_scouts=0.27,
    p_vector_forget=0.14,
    priority_coll_avoid_dist=0.41,
    empty_coll_avoid_dist=0.77,
    loaded_coll_avoid_dist=0.27,
    weight_find_dust=0.82,
    weight_find_dump=1.00,
)
EVOLVED = Genome(
    density_of_robots=0.3518,
    fraction_scouts=0.0,
    p_vector_forget=0.593,
    priority_coll_avoid_dist=0.587,
    empty_coll_avoid_dist=0.578,
    loaded_coll_avoid_dist=0.0,
    priority_signal_scouts=True,
    priority_signal_loaded=True,
    weight_find_dust=0.0219,
    weight_find_dump=0.934,
)
PRESETS = {"type1": TYPE1, "type2": TYPE2, "evolved": EVOLVED}
"""Genomes by name: the two types that evolved in the paper (Table 2), and the fittest of
`results/default/evolve-paper`."""


def load_genome(name: str) -> Genome:
    """Return a preset, or the genome in a JSON file.

    Args:
        name: name of a preset, or path of a JSON file with names and values of fields. Fields that
            the file leaves out have the values of type 1. The result.json of a run will do, too.

    Raises:
        UserError: unknown name, unreadable or broken file, unknown parameter, or value out of
            range.
    """
    if name in PRESETS:
        return PRESETS[name]
    path = Path(name)
    if not path.exists() or path.is_dir():
        constraint = f"a preset ({', '.join(PRESETS)}) or the path of a JSON file"
        fact = f"there is no file {shown(name)}" if path.suffix == ".json" else None
        raise ConfigError("genome", name, constraint, fact)

    values = _read_values(path, name)
    known = [field.name for field in fields(Genome)]
    unknown = sorted(set(values) - set(known))
    if unknown:
        fact = f"names {', '.join(map(repr, unknown))}"
        raise UserError(f"genome file {name} {fact}; allowed names are {', '.join(known)}.")
    try:
        return replace(TYPE1, **values)
    except UserError as error:
        raise UserError(f"genome file {name}: {error}") from None


def _read_values(path: Path, name: str) -> dict[str, Any]:
    """Return the names and values in a JSON file of a genome, or of a run's result.

    Raises:
        UserError: the file cannot be read, or holds no JSON object.
    """
    example = '{"use_hop_count": true, "p_vector_forget": 0.29}'
    values = read_json(path, f"write one object such as {example}", what="genome file ")
    if not isinstance(values, dict):
        fact = f"holds a {type(values).__name__}"
        raise UserError(f"genome file {name} {fact}; write one JSON object such as {example}.")
    of_run = values.get("genome")  # the file is the result.json of a run
    return of_run if isinstance(of_run, dict) else values
