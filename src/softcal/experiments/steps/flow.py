"""The volume that a pump has displaced, from a record of its flow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.experiments.step import Setting, register_step
from softcal.sensing.channel import channel_name, of_kind
from softcal.sensing.sensors.actuators import FLOW, VOLUME
from softcal.units import format_quantity


@register_step(keeps_gaps=True, start=Setting("pumped volume"), channel=Setting("channel"))
def integrate_flow(dataset: Dataset, start: float = 0.0, *, channel: str | None = None) -> Dataset:
    """The pumped volume in the place of a flow: its integral over time, linear between the samples.

    A factor on the flow is the same factor on the volume, so that the gain of a flow sensor is `volume_gain`. An offset
    of the flow is a drift of the volume: `zero` before this step, or `detrend` after it, takes it off.

    Parameters
    ----------
    start
        Volume [m^3] at the first sample.
    channel
        The flow, such as `main.flow`; None: the only one.

    Raises
    ------
    DatasetError
        If there is no flow or no time, there are several flows, a value is missing, or the volume was recorded too.
    """
    flows = of_kind(FLOW, dataset.channels)
    if channel is None and len(flows) != 1:
        what = "the record has several flows" if flows else "the record has no flow"
        attempt = f"channel: {flows[0]}" if flows else "a column such as main.flow"
        raise DatasetError(Fault(what, dataset.name, ", ".join(flows or dataset.channels), attempt=attempt))
    name = channel if channel is not None else flows[0]
    if channel_name(name).kind != FLOW:
        raise DatasetError(Fault("this channel is no flow", dataset.name, name, ", ".join(flows)))
    flow = dataset.values(name)
    volume = str(replace(channel_name(name), kind=VOLUME))
    faults: list[Fault] = []
    if "time" not in dataset.channels:
        what, attempt = "a flow is integrated over time, and the record has none", "a column for the channel time"
        faults.append(Fault(what, dataset.name, ", ".join(dataset.channels), attempt=attempt))
    if missing := int(np.isnan(flow).sum()):
        faults.append(
            Fault("a flow with missing values has no integral", f"{dataset.name}, {name}", f"{missing} of them")
        )
    if volume in dataset.channels:
        what, attempt = "the volume was recorded beside the flow", f"leave {name} out of the columns"
        faults.append(Fault(what, dataset.name, volume, attempt=attempt))
    if faults:
        raise DatasetError(faults)
    between = 0.5 * (flow[1:] + flow[:-1]) * np.diff(dataset.values("time"))
    pumped = start + np.concatenate([[0.0], np.cumsum(between)])
    outcome = (
        f"{volume} from {format_quantity(start, VOLUME.unit)} to {format_quantity(float(pumped[-1]), VOLUME.unit)}, "
        f"at most {format_quantity(float(np.abs(flow).max()), FLOW.unit)}"
    )
    channels = {key: one for key, one in dataset.channels.items() if key not in (name, f"{name}_sd")}
    step = Step("integrate_flow", {"start": start, "channel": name}, outcome)
    channels[volume] = Channel(pumped, VOLUME.unit)
    return replace(dataset, channels=channels, provenance=(*dataset.provenance, step))
