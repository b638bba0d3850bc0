"""The naming rule for units, and the few conversions.

SI inside: metre, radian, second, kilogram, newton, newton-metre. A name carries its unit where two could be meant
(`period_ns`, `alpha_rad`, `base_height_m`), and raw hardware words never share a name with physical values
(`encoder_counts`, `dac_raw` against `q`, `tau`). A joint quantity is rad or N·m on a revolute joint and m or N on a
prismatic one. Degrees, millimetres and milliseconds exist at two boundaries only: the programming libraries of the
papers, and the robot files (keys ending in `_deg`).
"""

from __future__ import annotations

import math
from typing import Final

RAD_PER_DEG: Final = math.pi / 180.0
DEG_PER_RAD: Final = 180.0 / math.pi
M_PER_MM: Final = 1e-3
MM_PER_M: Final = 1e3
NS_PER_S: Final = 1_000_000_000
NS_PER_MS: Final = 1_000_000
NS_PER_US: Final = 1_000
US_PER_MS: Final = 1_000
MS_PER_S: Final = 1e3
S_PER_MS: Final = 1e-3
