"""`iswarm cache`: compiled programs that are kept for later runs."""

from dataclasses import dataclass

from iswarm_mj.utils.program_cache import MAX_SIZE, Entry, cache_folder, entries, remove

_MB = 1e6


@dataclass(frozen=True)
class Cache:
    """Show where compiled programs are kept and how large they are, or remove them all."""

    HAS_CONFIG = False

    clear: bool = False
    """Remove all compiled programs; the next run compiles what it needs again."""

    def run(self) -> None:
        """Run the command."""
        folder = cache_folder()
        found = entries(folder)
        libraries: dict[str, list[Entry]] = {}
        for entry in found:
            libraries.setdefault(entry.path.parent.name, []).append(entry)

        print(f"{folder}: {_size(found)}; at most {MAX_SIZE / _MB:.0f} MB are kept")
        for name, its_entries in libraries.items():
            print(f"  {name}: {_size(its_entries)}")
        if not self.clear:
            return

        for entry in found:
            remove(entry.path)
        left = entries(folder)
        if left:
            print(f"cleared, but for {_size(left)} that are new or cannot be removed")
        else:
            print("cleared")


def _size(found: list[Entry]) -> str:
    """Return the size of entries as text."""
    return f"{sum(entry.size for entry in found) / _MB:.1f} MB"
