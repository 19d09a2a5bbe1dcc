"""What the pictures of a seed have that changes no depth but what is said here: each in its share of the seeds."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields

from radcam_depth_ros.simulation.settings.errors import require_ranges
from radcam_depth_ros.simulation.settings.randomness import Stream, generator


@dataclass(frozen=True)
class LooksConfig:
    """Shares of the seeds, 0 to 1, whose pictures have something.

    Attributes:
        lettering: Letters and pictures on the flanks of vehicles, on shops and on boards.
        reflections: Surroundings mirrored in glass, windows and paint: roofs and trees before the sky, and the ground.
        wear: Leaves, cracks, patches, seams and stains in fine detail on plants and roads.
        beams: Head lamps with a bright middle and a steep fall to the dark, and red light of tail lamps.
        bonnet: The own bonnet or dashboard at the lower edge; the exact depth is unknown (NaN) there, the class 255.
        dirt: Dirt on the lens.
        rolling_shutter: Rows that are taken one after another while the vehicle turns; exact depth and classes follow.
        white_balance: White balance that follows the light, as nearly all cameras have it.
    """

    lettering: float = 0.6
    reflections: float = 0.7
    wear: float = 0.7
    beams: float = 0.8
    bonnet: float = 0.15
    dirt: float = 0.15
    rolling_shutter: float = 0.3
    white_balance: float = 0.9

    def __post_init__(self) -> None:
        require_ranges("looks", self, {entry.name: (0, 1) for entry in fields(self)})


@dataclass(frozen=True)
class Looks:
    """What the pictures of one seed have; see `LooksConfig`."""

    lettering: bool = False
    reflections: bool = False
    wear: bool = False
    beams: bool = False
    bonnet: bool = False
    dirt: bool = False
    rolling_shutter: bool = False
    white_balance: bool = False


NO_LOOKS = Looks()
"""Pictures with nothing of it."""


def draw_looks(seed: int, config: LooksConfig) -> Looks:
    """Draws what the pictures of a seed have."""
    # One number for each, so that another share of one leaves the others as they were.
    drawn = generator(seed, Stream.LOOKS).random(len(fields(config)))
    shares = asdict(config)
    return Looks(**{name: bool(number < share) for number, (name, share) in zip(drawn, shares.items(), strict=True)})
