"""Names in a swarm's recording, for those who query it: entities, their components in time, units and meanings."""

from typing import NamedTuple


class Name(NamedTuple):
    """A component that changes in time, on the timelines `step` and `sim_time`."""

    entity: str
    """NAME stands for a vector that the strategy remembers, as dust and dump, or for a metric or an area of the task, N
    for a robot."""
    component: str
    unit: str
    """Empty for numbers without one, and for what is no number."""
    description: str


_ROBOT, _BALL, _LINK = "world/robots/body", "world/balls/true_size", "world/links"
NAMES = (
    Name(_ROBOT, "Boxes3D:centers", "mm", "one a robot, by its number; the arena is centred on the origin"),
    Name(_ROBOT, "Boxes3D:quaternions", "", "x, y, z, w; the robot looks along its x axis"),
    Name(_ROBOT, "Boxes3D:class_ids", "", "0 empty, 2 scout, 4 loaded; plus 1 if it sends priority"),
    Name(_ROBOT, "message", "", "the 32 bits that its first LED sent"),
    Name(_ROBOT, "said_NAME", "", "a field of the message that is no vector, units as declared, lengths in m"),
    Name(_ROBOT, "NAME_hop", "", "hop count of the remembered vector, -1 without one"),
    Name(_ROBOT, "NAME_hop_colour", "", "its colour, 0xRRGGBBAA"),
    Name(_ROBOT, "turn_deg", "deg", "carried out in the step, anticlockwise"),
    Name(_ROBOT, "forward_mm", "mm", "walked in the step if nothing is in the way"),
    Name("world/robots/front", "Points3D:positions", "mm", "of the dot at each robot's front"),
    Name(_BALL, "Points3D:positions", "mm", "one a ball, by its number"),
    Name(_BALL, "Points3D:class_ids", "", "10 on the floor, 11 held, 12 delivered"),
    Name(_BALL, "holder", "", "number of the robot that holds it, -1 if none does"),
    Name("world/balls/marker", "Points3D:positions", "mm", "above the ball and the robots"),
    Name("world/balls/marker", "Points3D:class_ids", "", "as of the ball"),
    Name(_LINK, "LineStrips3D:strips", "mm", "from receiver to sender, one a link"),
    Name(_LINK, "LineStrips3D:class_ids", "", "21 heard, 20 damaged message"),
    Name(_LINK, "receiver", "", "number of the robot that receives"),
    Name(_LINK, "side", "", "that receives: 0 front, 1 left, 2 back, 3 right"),
    Name(_LINK, "sender", "", "number of the robot that sends"),
    Name(_LINK, "led", "", "LED that sends, counted as the sides"),
    Name(_LINK, "is_heard", "", "the message arrived undamaged"),
    Name("world/trails", "LineStrips3D:strips", "mm", "where loaded robots were in the last 20 steps"),
    Name("world/trails", "robot", "", "number of the robot of each trail"),
    Name("world/memory/NAME", "Arrows3D:origins", "mm", "above the robots that know the vector"),
    Name("world/memory/NAME", "Arrows3D:vectors", "mm", "the vector, turned to the arena"),
    Name("world/memory/NAME", "robot", "", "number of the robot of each arrow"),
    Name("world/arena/NAME", "Boxes3D:centers", "mm", "areas of the task; of discs Cylinders3D"),
    Name("world/arena/NAME", "Boxes3D:half_sizes", "mm", "likewise"),
    Name("memory/NAME", "Scalars:scalars", "", "what else of the memory is recorded, one series a robot"),
    Name("states/robot_N", "StateChange:state", "", "from this step on; only of the robots that have a lane"),
    Name("series/states", "Scalars:scalars", "", "robots in each state, in the order of `SeriesLines:names`"),
    Name("series/known/NAME", "Scalars:scalars", "", "share of the robots that know the vector"),
    Name("series/balls/picked", "Scalars:scalars", "", "balls picked up so far"),
    Name("series/balls/delivered", "Scalars:scalars", "", "balls delivered so far"),
    Name("series/collisions", "Scalars:scalars", "", "so far"),
    Name("series/mean_speed", "Scalars:scalars", "mm/s", "of the robots in the step"),
    Name("series/task/NAME", "Scalars:scalars", "", "a metric of the task, in its unit"),
)
"""All that change in time; what does not, as sizes and colours, are components of the same entities without time."""
