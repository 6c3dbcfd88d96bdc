"""Laws of adhesion and electrostatics: pure functions of SI arguments."""
