"""What is called as a run goes on; the terminal shows it, a notebook need not."""


class RunProgress:
    """Methods that are called as a run goes on; these show nothing."""

    def compiling(self) -> None:
        """Kernels are compiled, once on this machine, before the trials begin."""

    def begin(self, trials: int, found: int) -> None:
        """The run has so many (estimator, trial) pairs in all, and so many of them on disk."""

    def advance(self, what: str, trials: int, failed: int, share: float) -> None:
        """A part is done, and this share of the processor time is spent by now."""

    def say(self, line: str) -> None:
        """The user should know this."""
