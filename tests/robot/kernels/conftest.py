import pytest


@pytest.fixture(params=["compiled", "interpreted"])
def variant(request):
    """Gives a kernel as it is called, and as the plain Python function that it was made of."""

    def choose(kernel):
        # With NUMBA_DISABLE_JIT=1 there is only the plain function.
        return kernel if request.param == "compiled" else getattr(kernel, "py_func", kernel)

    return choose
