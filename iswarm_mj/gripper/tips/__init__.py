"""Tips of the tool: profiles, forces by boundary elements, voltages, tables for the plugins."""
