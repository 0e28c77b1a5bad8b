"""What passed between a CR30 and any program, as the exchanges that our driver has with one.

Bytes are put together to packets by their check bytes, however they were cut or where a recording
begins; what was sent again counts once. A measurement is a header, after a trigger or after a press
of the button, with the four packets of its spectrum.
"""
from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from spectrabox.capture.meter.instruments import cr30
from spectrabox.capture.transcripts.transcript import Event, Transcript
from spectrabox.radiometry.errors import InputError

CONNECTING = (*cr30.IDENTITY, *cr30.START)


# seconds, and the sixty bytes that were complete then
Packet = tuple[float, bytes]


def as_our_driver_has_it(recording: Transcript,
                         steps: Sequence[tuple[str, tuple[Event, ...]]]) -> Transcript:
    """The transcript of the steps of a recording that a player plays to our driver."""
    return Transcript({**recording.facts, "instrument": cr30.Cr30.name,
                       "line": str(cr30.Cr30.baud)},
                      tuple(event for _, events in steps for event in events), recording.file)


def cr30_traffic(transcript: Transcript) -> tuple[list[tuple[str, tuple[Event, ...]]], list[str]]:
    """The steps of a recording in order, and what of it is in none of them.

    Parameters
    ----------
    transcript : Transcript

    Returns
    -------
    steps : list of (str, events)
        What was done, "connect", a kind of calibration, or "measure", with the requests and replies
        that our driver has then. A measurement by the button begins with what the instrument says.
    problems : list of str

    Raises
    ------
    InputError
        If it holds no packet of a CR30.
    """
    computer, _ = _packets(transcript.events, ">")
    instrument, lost = _packets(transcript.events, "<")
    if not instrument:
        raise InputError(f"{transcript.file} holds no packet of a CR30, whose traffic alone can be "
                         "read from recordings of other programs")
    packets = [*((">", packet) for packet in computer), *(("<", packet) for packet in instrument)]
    steps, problems = _steps(sorted(packets, key=lambda directed: directed[1][0]))
    if lost:
        problems.insert(0, f"{lost} bytes of the instrument belong to no whole packet")
    if not any(what == "measure" for what, _ in steps):
        problems.append("the recording holds no whole measurement")
    return steps, problems


def _packets(events: Sequence[Event], direction: str) -> tuple[list[Packet], int]:
    """Whole packets of one direction, and how many bytes belong to none."""
    packets: list[Packet] = []
    stream = bytearray()
    lost, time_s = 0, 0.0
    for number, event in enumerate(events):
        time_s += event.delay_s
        if event.direction != direction:
            continue
        stream += event.data
        while len(stream) >= cr30.PACKET_BYTES:
            # an instrument answers a request whose check byte is wrong, as was seen
            if cr30.is_packet(bytes(stream[:cr30.PACKET_BYTES])) or (direction == ">"
                                                           and stream[0] in (0xAA, 0xBB)):
                # recordings without times keep their order by a nanosecond an event
                packets.append((time_s + number * 1e-9, bytes(stream[:cr30.PACKET_BYTES])))
                del stream[:cr30.PACKET_BYTES]
            else:
                del stream[:1]
                lost += 1
    return packets, lost + len(stream)


def _steps(packets: Sequence[tuple[str, Packet]]
           ) -> tuple[list[tuple[str, tuple[Event, ...]]], list[str]]:
    connect: dict[str, Packet] = {}     # replies by command
    steps: list[tuple[str, tuple[Event, ...]]] = []
    unasked, unfinished = 0, Counter[str]()
    # a measurement whose spectrum is not complete: its header, when it was triggered, which a press
    # of the button does not tell, and the parts of its spectrum
    header: Packet | None = None
    triggered_s: float | None = None
    parts: dict[str, Packet] = {}
    asked: dict[str, float] = {}        # when, of commands that wait for their answer

    def close() -> None:
        nonlocal header, parts, unasked
        if header is not None and not parts:
            unasked += 1
        elif header is not None:
            unfinished[", ".join(part[4:] for part in cr30.PARTS if part not in parts)] += 1
        header, parts = None, {}

    for direction, packet in packets:
        time_s, content = packet
        command = content[:3].hex()
        if direction == ">":
            asked[command] = time_s
        elif content.startswith(cr30.HEADER):
            if header is not None and header[1] == content and cr30.TRIGGER not in asked \
                    and not parts and triggered_s is not None:
                continue                # the same one, sent or noted twice
            close()
            header, triggered_s = packet, asked.pop(cr30.TRIGGER, None)
        elif command in cr30.PARTS and header is not None:
            parts.setdefault(command, packet)
            if set(parts) == set(cr30.PARTS):
                begun = "" if triggered_s is None else cr30.TRIGGER
                steps.append(("measure", _exchange(triggered_s, {
                    begun: header, **{part: parts[part] for part in cr30.PARTS}})))
                header, parts = None, {}
        elif connecting := next((each for each in CONNECTING
                                 if content.startswith(bytes.fromhex(each))), None):
            connect.setdefault(connecting, packet)
        elif calibration := next((which for which, (each, _) in cr30.CALIBRATIONS.items()
                                  if content.startswith(bytes.fromhex(each))), None):
            steps.append((calibration, _exchange(
                asked.pop(command, None), {cr30.CALIBRATIONS[calibration][0]: packet})))
    close()
    problems = [f"{unasked} measurements have no spectrum in the recording: it was not asked for"] \
        if unasked else []
    problems += [f"{count} measurements lack the parts {missing} of their spectrum"
                 for missing, count in unfinished.items()]
    if set(connect) == set(CONNECTING):
        steps.insert(0, ("connect", _exchange(None, {each: connect[each] for each in CONNECTING})))
    return steps, problems


def _exchange(before_s: float | None, replies: Mapping[str, Packet]) -> tuple[Event, ...]:
    """Each request with its reply, as our driver has it; no request of a reply to no command."""
    events = []
    for command, (time_s, content) in replies.items():
        if command:
            events.append(Event(">", 0.0, cr30.request(command)))
        events.append(Event("<", 0.0 if before_s is None else max(time_s - before_s, 0.0), content))
        before_s = time_s
    return tuple(events)
