"""What every test shares: hypothesis profiles, and caches of kernels that nobody else writes."""

import os
import tempfile

from hypothesis import HealthCheck, settings

# A deadline would fail on a kernel's first call, which compiles it (545 ms measured).
settings.register_profile("dev", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile(
    "ci", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "dev"))

# With a warm cache NUMBA_BOUNDSCHECK=1 silently does nothing: that run gets a cache of its own.
if os.environ.get("NUMBA_BOUNDSCHECK") == "1":
    os.environ["NUMBA_CACHE_DIR"] = tempfile.mkdtemp(prefix="gstream-bounds-")

# Two processes that compile one kernel for two types at once may each load what the other has
# stored (numba issue 4807), so each worker of `pytest -n` has a cache of its own.
elif worker := os.environ.get("PYTEST_XDIST_WORKER"):
    caches = os.environ.get("NUMBA_CACHE_DIR", os.path.abspath(".pytest_cache/numba"))
    os.environ["NUMBA_CACHE_DIR"] = os.path.join(caches, worker)
