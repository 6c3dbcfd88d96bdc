# The public names, one line each, where they are defined. `__init__.py` imports them when they are
# first used.
from .core import State as State
from .env import Env as Env
from .gymnasium import SwarmEnv as SwarmEnv
from .gymnasium import SwarmVectorEnv as SwarmVectorEnv
from .gymnasium import single_env as single_env
from .gymnasium import vector_env as vector_env
from .pettingzoo import SwarmParallelEnv as SwarmParallelEnv
from .pettingzoo import parallel_env as parallel_env
from .policy import PolicyStrategy as PolicyStrategy
from .watch import EnvRecording as EnvRecording
from .watch import Pictures as Pictures
