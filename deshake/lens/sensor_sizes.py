"""Sizes of the sensors of well-known cameras, as the makers' specifications give them.

The table serves cameras that write FocalLength alone. The names are EXIF's Model. They must match
exactly, except for case, since a similar name often means another sensor.
"""

from __future__ import annotations

from typing import Final

__all__ = ["sensor_size"]

# Width and height in millimetres, and the cameras with this sensor.
_SENSORS: Final[dict[tuple[float, float], tuple[str, ...]]] = {
    (43.8, 32.9): ("GFX 50S", "GFX 50R"),
    (36.0, 24.0): (
        "Canon EOS 5D Mark II", "Canon EOS 5D Mark III", "Canon EOS 5D Mark IV", "Canon EOS 5DS",
        "Canon EOS 5DS R", "Canon EOS-1Ds Mark II", "Canon EOS-1Ds Mark III", "Canon EOS-1D X",
        "Canon EOS R", "Canon EOS R5",
    ),
    (36.0, 23.9): ("NIKON D3", "NIKON D3S", "NIKON D3X", "NIKON D700", "NIKON D4", "NIKON D4S",
                   "NIKON DF"),
    (35.9, 24.0): (
        "NIKON D600", "NIKON D610", "NIKON D750", "NIKON D800", "NIKON D800E", "NIKON D810",
        "ILCE-7R", "ILCE-7RM2", "ILCE-7RM3", "Canon EOS 6D Mark II", "Canon EOS RP",
        "PENTAX K-1", "PENTAX K-1 Mark II", "DSLR-A850", "DSLR-A900",
    ),
    (35.9, 23.9): ("NIKON D850", "NIKON Z 6", "NIKON Z 7", "NIKON Z 5", "NIKON Z 6_2",
                   "NIKON Z 7_2", "NIKON Z 9", "NIKON Z 8", "NIKON D780", "Canon EOS R6"),
    (35.8, 23.9): ("Canon EOS 5D", "Canon EOS 6D", "ILCE-7", "ILCE-7M2", "SLT-A99V"),
    (35.6, 23.8): ("ILCE-7M3", "ILCE-7S", "ILCE-7SM2", "ILCE-9", "ILCE-7SM3", "DC-S1", "DC-S5"),
    (28.7, 19.1): ("Canon EOS-1D", "Canon EOS-1D Mark II", "Canon EOS-1D Mark II N"),
    (28.1, 18.7): ("Canon EOS-1D Mark III",),
    (27.9, 18.6): ("Canon EOS-1D Mark IV",),
    (23.7, 15.6): ("NIKON D1", "NIKON D1H", "NIKON D1X", "NIKON D40", "NIKON D50", "NIKON D70",
                   "NIKON D70s", "NIKON D100"),
    (23.7, 15.7): ("NIKON D2X", "NIKON D2Xs", "PENTAX K-5", "PENTAX K-5 II", "PENTAX K-30",
                   "PENTAX K-50", "GR"),
    (23.6, 15.8): (
        "NIKON D40X", "NIKON D60", "NIKON D80", "NIKON D90", "NIKON D200", "NIKON D300",
        "NIKON D300S", "NIKON D3000", "NIKON D5000", "FinePix X100", "PENTAX K-x", "DSLR-A100",
    ),
    (23.6, 15.6): (
        "NIKON D7000", "NIKON D5100", "X-Pro1", "X-E1", "X-E2", "X-M1", "X-T1", "X-T10", "X-Pro2",
        "X-T2", "X-T20", "X-E3", "X-H1", "X100F",
    ),
    (23.5, 15.6): (
        "NIKON D7100", "NIKON D7200", "NIKON D5200", "NIKON D5300", "NIKON D5500", "NIKON D5600",
        "NIKON D3300", "NIKON D3400", "PENTAX K-3", "X-T3", "X-T30", "X-T4", "X-Pro3", "X100V",
        "ILCE-5000", "ILCE-5100", "ILCE-6000", "ILCE-6300", "ILCE-6400", "ILCE-6500", "ILCE-6600",
        "NEX-5N", "NEX-6", "NEX-7", "SLT-A65V", "SLT-A77V", "ILCA-77M2", "DSLR-A700",
    ),
    (23.5, 15.7): ("NIKON D500", "NIKON D7500", "NIKON Z 50", "NIKON Z fc"),
    (23.2, 15.4): ("NIKON D3200",),
    (23.1, 15.4): ("NIKON D3100",),
    (22.7, 15.1): (
        "Canon EOS 10D", "Canon EOS D30", "Canon EOS D60", "Canon EOS 300D DIGITAL",
        "Canon EOS DIGITAL REBEL",
    ),
    (22.5, 15.0): ("Canon EOS 20D", "Canon EOS 30D", "Canon EOS 70D"),
    (22.4, 15.0): ("Canon EOS 7D Mark II",),
    (22.3, 14.9): (
        "Canon EOS 7D", "Canon EOS 50D", "Canon EOS 60D", "Canon EOS 77D", "Canon EOS 80D",
        "Canon EOS 100D", "Canon EOS 200D", "Canon EOS 500D", "Canon EOS 550D", "Canon EOS 600D",
        "Canon EOS 650D", "Canon EOS 700D", "Canon EOS 750D", "Canon EOS 760D", "Canon EOS 800D",
        "Canon EOS 1200D", "Canon EOS 1300D", "Canon EOS 2000D", "Canon EOS M", "Canon EOS M3",
        "Canon EOS M5", "Canon EOS M6", "Canon EOS M50", "Canon EOS REBEL SL1",
        "Canon EOS REBEL T1i", "Canon EOS REBEL T2i", "Canon EOS REBEL T3i", "Canon EOS REBEL T4i",
        "Canon EOS REBEL T5i", "Canon EOS Rebel T6i",
    ),
    (22.2, 14.8): (
        "Canon EOS 40D", "Canon EOS 350D DIGITAL", "Canon EOS 400D DIGITAL", "Canon EOS 450D",
        "Canon EOS 1000D", "Canon EOS 1100D", "Canon EOS DIGITAL REBEL XT",
        "Canon EOS DIGITAL REBEL XTi", "Canon EOS DIGITAL REBEL XSi", "Canon EOS REBEL T3",
    ),
    (17.3, 13.0): (
        "E-1", "E-3", "E-5", "E-30", "E-300", "E-330", "E-400", "E-410", "E-420", "E-450", "E-500",
        "E-510", "E-520", "E-620", "E-P1", "E-P2", "E-P3", "E-P5", "E-PL1", "E-PL2", "E-PL3",
        "E-PL5", "E-PM1", "E-M1", "E-M1MarkII", "E-M5", "E-M5MarkII", "E-M10", "PEN-F", "OM-1",
        "DMC-G1", "DMC-G2", "DMC-G3", "DMC-G5", "DMC-G6", "DMC-G7", "DMC-GF1", "DMC-GF2",
        "DMC-GF3", "DMC-GH3", "DMC-GH4", "DMC-GX1", "DMC-GX7", "DMC-GX8", "DC-GH5", "DC-G9",
    ),
    (13.2, 8.8): (
        "DSC-RX100", "DSC-RX100M2", "DSC-RX100M3", "DSC-RX100M4", "DSC-RX100M5", "DSC-RX10",
        "DSC-RX10M2", "DSC-RX10M3", "DSC-RX10M4", "DMC-FZ1000", "Canon PowerShot G7 X",
        "Canon PowerShot G9 X", "Canon PowerShot G5 X", "NIKON 1 J1", "NIKON 1 V1", "NIKON 1 J2",
        "NIKON 1 V2", "NIKON 1 J3", "NIKON 1 S1",
    ),
    (8.8, 6.6): ("X10", "X20", "X30"),
    (7.44, 5.58): ("Canon PowerShot G11", "Canon PowerShot G12", "Canon PowerShot S90",
                   "Canon PowerShot S95", "Canon PowerShot S100"),
    (5.76, 4.29): ("Canon DIGITAL IXUS 70", "Canon PowerShot SD1000", "Canon PowerShot A570 IS"),
}  # fmt: skip
_BY_MODEL: Final = {model.casefold(): size for size, models in _SENSORS.items() for model in models}
_MAKES: Final = ("canon", "nikon", "olympus", "om digital", "panasonic", "sony", "fujifilm",
                 "pentax", "ricoh")  # fmt: skip


def sensor_size(make: str, model: str) -> tuple[float, float] | None:
    """Return the sensor's width and height in millimetres, the longer first; None: not known.

    Parameters
    ----------
    make, model : str
        As EXIF has them.

    """
    listed = make.casefold().startswith(_MAKES)
    return _BY_MODEL.get(model.casefold()) if listed else None
