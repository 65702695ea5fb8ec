"""What results were made with: the processor, and the versions of packages that decide them."""

import platform
from importlib import metadata
from pathlib import Path

_RECORDED_PACKAGES = ("pcm_gym", "gymnasium", "stable-baselines3", "torch", "numpy", "numba", "scipy")


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide the result."""
    return {
        "python": platform.python_version(),
        **{package: version_of(package) or "not installed" for package in _RECORDED_PACKAGES},
    }


def processor() -> str:
    """Name of the processor, as its maker calls it where the system tells."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or "unknown"


def version_of(package: str) -> str | None:
    """Version of an installed package; None for one that is not."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
