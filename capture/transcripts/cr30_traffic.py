"""What passed between a CR30 and any program, as the exchanges that our driver has with one.

Bytes are put together to packets by their check bytes, however they were cut or where a recording
begins; what was sent again counts once. A measurement is a header, after a trigger or after a press
of the button, with the four packets of its spectrum.
"""
from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from spectrabox.capture.meter.instruments import cr30
from spectrabox.capture.transcripts.transcript import Event, Transcript
from spectrabox.radiometry.errors import InputError

CONNECTING = (*cr30.IDENTITY, *cr30.START)


@dataclass(frozen=True)
class Packet:
    """Sixty bytes, and when they were complete."""

    from_computer: bool
    time_s: float
    content: bytes


@dataclass(frozen=True)
class Step:
    """One thing that was done: "connect", a kind of calibration, or "measure"."""

    what: str
    by_button: bool = False
    header: Packet | None = None
    replies: dict[str, Packet] = field(default_factory=dict)    # by command
    asked_s: float | None = None

    def events(self) -> Iterator[Event]:
        """As our driver has it: each request with its reply."""
        before_s = self.asked_s
        if self.header is not None:
            if not self.by_button:
                yield Event(">", 0.0, cr30.request(cr30.TRIGGER))
            yield Event("<", _since(before_s, self.header), self.header.content)
            before_s = self.header.time_s
        for command, packet in self.replies.items():
            yield Event(">", 0.0, cr30.request(command))
            yield Event("<", _since(before_s, packet), packet.content)
            before_s = packet.time_s


def as_our_driver_has_it(recording: Transcript, steps: Sequence[Step]) -> Transcript:
    """The transcript of the steps of a recording that a player plays to our driver."""
    return Transcript({**recording.facts, "instrument": cr30.Cr30.name,
                       "line": str(cr30.Cr30.line_settings.baud)},
                      tuple(event for step in steps for event in step.events()), recording.file)


def cr30_traffic(transcript: Transcript) -> tuple[list[Step], list[str]]:
    """The steps of a recording in order, and what of it is in none of them.

    Parameters
    ----------
    transcript : Transcript

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
    packets = sorted([*computer, *instrument], key=lambda packet: packet.time_s)
    steps, problems = _steps(packets)
    if lost:
        problems.insert(0, f"{lost} bytes of the instrument belong to no whole packet")
    if not any(step.what == "measure" for step in steps):
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
                packets.append(Packet(direction == ">", time_s + number * 1e-9,
                                      bytes(stream[:cr30.PACKET_BYTES])))
                del stream[:cr30.PACKET_BYTES]
            else:
                del stream[:1]
                lost += 1
    return packets, lost + len(stream)


def _steps(packets: Sequence[Packet]) -> tuple[list[Step], list[str]]:
    connect = Step("connect")
    steps: list[Step] = []
    unasked, unfinished = 0, Counter[str]()
    open_step: Step | None = None       # a measurement whose spectrum is not complete
    asked: dict[str, float] = {}        # when, of commands that wait for their answer

    def close() -> None:
        nonlocal open_step, unasked
        if open_step is not None and not open_step.replies:
            unasked += 1
        elif open_step is not None:
            unfinished[", ".join(part[4:] for part in cr30.PARTS
                                 if part not in open_step.replies)] += 1
        open_step = None

    for packet in packets:
        command = packet.content[:3].hex()
        if packet.from_computer:
            asked[command] = packet.time_s
        elif packet.content.startswith(cr30.HEADER):
            if open_step is not None and open_step.header is not None \
                    and open_step.header.content == packet.content and cr30.TRIGGER not in asked \
                    and not open_step.replies and not open_step.by_button:
                continue                # the same one, sent or noted twice
            close()
            asked_s = asked.pop(cr30.TRIGGER, None)
            open_step = Step("measure", asked_s is None, packet, asked_s=asked_s)
        elif command in cr30.PARTS and open_step is not None:
            open_step.replies.setdefault(command, packet)
            if set(open_step.replies) == set(cr30.PARTS):
                steps.append(replace(open_step, replies={part: open_step.replies[part]
                                                         for part in cr30.PARTS}))
                open_step = None
        elif connecting := next((each for each in CONNECTING
                                 if packet.content.startswith(bytes.fromhex(each))), None):
            connect.replies.setdefault(connecting, packet)
        elif calibration := next((which for which, (each, _) in cr30.CALIBRATIONS.items()
                                  if packet.content.startswith(bytes.fromhex(each))), None):
            steps.append(Step(calibration, replies={cr30.CALIBRATIONS[calibration][0]: packet},
                              asked_s=asked.pop(command, None)))
    close()
    problems = [f"{unasked} measurements have no spectrum in the recording: it was not asked for"] \
        if unasked else []
    problems += [f"{count} measurements lack the parts {missing} of their spectrum"
                 for missing, count in unfinished.items()]
    if set(connect.replies) == set(CONNECTING):
        steps.insert(0, replace(connect, replies={each: connect.replies[each]
                                                  for each in CONNECTING}))
    return steps, problems


def _since(before_s: float | None, packet: Packet) -> float:
    return 0.0 if before_s is None else max(packet.time_s - before_s, 0.0)
