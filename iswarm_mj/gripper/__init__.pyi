# The public names, one line each, where they are defined. `__init__.py` imports them when they are
# first used.
from .bench.protocol import Protocol as Protocol
from .bench.tracing import Trace as Trace
from .bench.tracing import trace_trial as trace_trial
from .bench.trial import Contacts as Contacts
from .bench.trial import Trial as Trial
from .laws.adhesion import dmt_pull_off as dmt_pull_off
from .laws.adhesion import humidity_factor as humidity_factor
from .laws.adhesion import jkr_pull_off as jkr_pull_off
from .laws.adhesion import van_der_waals_force as van_der_waals_force
from .laws.detachment import WORK_OBJECT_SUBSTRATE as WORK_OBJECT_SUBSTRATE
from .laws.detachment import WORK_TOOL_OBJECT as WORK_TOOL_OBJECT
from .laws.detachment import detachment_voltage as detachment_voltage
from .laws.detachment import grasp_voltage as grasp_voltage
from .laws.detachment import release_voltage as release_voltage
from .laws.electrostatics import pick_force as pick_force
from .laws.electrostatics import release_force as release_force
from .laws.probe_table import probe_factor as probe_factor
from .laws.roughness import Surface as Surface
from .plugin import register_plugins as register_plugins
from .plugin import state_index as state_index
