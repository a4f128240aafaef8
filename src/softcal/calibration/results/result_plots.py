"""The plots of a result: the figures of the report, from Python."""

from __future__ import annotations

from typing import TYPE_CHECKING

from softcal.display import plotted

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class ResultPlots:
    """Plots of a result, or of several calibrations together: those of the report, in the style of the report.

    Each returns the Matplotlib axes that it drew in; nothing is shown or saved. Axes that are given keep their style.
    """

    def plot(self, experiment: str = "") -> list[Axes]:
        """Every channel of an experiment, measured and simulated with its 95 % bands, the residual beneath each.

        Parameters
        ----------
        experiment
            Its name; by default the first.

        Raises
        ------
        ParameterError
            Where there is no such experiment, or none with such channels.
        """
        return plotted("plot_trajectory", self, experiment)

    def plot_fit(self, channel: str = "", experiment: str = "", *, ax: Axes | None = None) -> Axes:
        """One channel, measured and simulated with its 95 % bands.

        Parameters
        ----------
        channel
            The channel, such as "tension"; by default the first.
        experiment
            Name of the experiment; by default the first.
        ax
            Axes to draw into; by default those of a new figure.

        Raises
        ------
        ParameterError
            Where there is no such experiment or channel, or `ax` are no axes.
        """
        return plotted("plot_fit", self, channel, experiment, ax)

    def plot_intervals(self, parameter: str = "", *, ax: Axes | None = None) -> Axes:
        """The estimates of a parameter with their 95 % intervals, one for each calibration and experiment that has it.

        Parameters
        ----------
        parameter
            Its name without an experiment; by default the first.
        ax
            Axes to draw into; by default those of a new figure.

        Raises
        ------
        ParameterError
            Where there is no such parameter, or `ax` are no axes.
        """
        return plotted("plot_intervals", self, parameter, ax)

    def plot_loss(self, parameter: str = "", *, ax: Axes | None = None) -> Axes:
        """The loss over a parameter: least over all others as the derivatives predict it, or at the trials of a search.

        Parameters
        ----------
        parameter
            Its name; by default the first, or both of a search without derivatives over two or more.
        ax
            Axes to draw into; by default those of a new figure.

        Raises
        ------
        ParameterError
            Where there is no such parameter, or `ax` are no axes.
        """
        return plotted("plot_loss", self, parameter, ax)
