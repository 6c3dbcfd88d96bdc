"""A physics-based simulator of the I-SWARM micro-robot swarm on MuJoCo."""

import os

__version__ = "0.1.0"

# JAX 0.10 and 0.11 report every program that they load from their compilation cache on a CPU as an error, because the
# features stored with it include two preferences of the compiler that no processor has. XLA reads its log level
# when JAX is imported, so this works only if the package is imported before JAX. The user's own setting takes
# precedence.
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
