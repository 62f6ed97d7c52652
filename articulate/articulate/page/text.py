"""Text of pages: escaping, numbers, and values along axes."""

from __future__ import annotations

import html
import math
import sys


def escape_text(text: object) -> str:
    """Escape text for HTML and its attributes."""
    return html.escape(str(text), quote=True)


def format_number(value: str | float | bool | None) -> str:
    """Format a value: at most four digits, thin spaces between thousands, – for None and NaN."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value
    if not math.isfinite(value):
        return "–" if math.isnan(value) else ("∞" if value > 0 else "−∞")
    if isinstance(value, int) or (float(value).is_integer() and abs(value) < 1e15):
        text = f"{int(value):,}".replace(",", "\u202f")
    elif 1e-3 <= abs(value) < 1e4:
        text = f"{value:.4g}"
    elif abs(value) < 1e-3:
        mantissa, exponent = f"{value:.2e}".split("e")
        text = f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
    else:
        text = f"{round(value):,}".replace(",", "\u202f")
    return text.replace("-", "−")


def axis_values(low: float, high: float, count: int = 5) -> list[float]:
    """Return about ``count`` values in [low, high]: multiples of 1, 2 or 5 times a power of 10."""
    if not high > low:
        return [low]
    rough = (high - low) / count
    if rough < sys.float_info.min:  # too close for a value between them
        return [low]
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= rough * 0.7)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    digits = max(0, -math.floor(math.log10(step)) + 1)
    return [round(i * step, digits) for i in range(first, last + 1)]


def format_axis_value(value: float) -> str:
    """Format a value along an axis: 250k, 1.5M, 0.25."""
    for size, unit in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= size and (size > 1e3 or abs(value) >= 1e4):
            return f"{value / size:.4g}{unit}".replace("-", "−")
    return format_number(value)
