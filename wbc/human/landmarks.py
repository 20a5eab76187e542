"""Places of markers on a human, and the names that laboratories give to them.

Names are those of Plug-in Gait and CGM2 (Vicon), Helen Hayes, HBM (Motek), IOR (Leardini 2007),
ISB (Wu 2002, 2005), OpenSim's gait2392, Rajagopal and OpenCap, CMU, Visual3D, OptiTrack's baseline,
Qualisys' animation and Xsens; and joints as cameras find them without markers (COCO, HALPE,
OpenPose, MediaPipe). Spelling, separators and the place of the side do not matter: ``R.ASIS``,
``RASI``, ``r_asis_study``, ``ASIS_R``, ``WaistRFront``.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import itemgetter


@dataclass(frozen=True)
class Landmark:
    """A place on a segment."""

    name: str  # such as left_asis
    segment: str  # the segment it moves with
    anchor: str  # the segment from whose origin, a joint on segment, places are measured
    place: tuple[float, float, float]  # in the axes of segment [m], of the reference stature
    spread: float  # standard deviation of the place [m]
    noise: float  # standard deviation of the movement of skin and marker against the bone [m]


# Landmarks of both sides: segment, anchor, place on the left [mm], spread and noise [mm], names
# without the side.
_Row = tuple[str, str, tuple[float, float, float], float, float, str]
_PAIRED: dict[str, _Row] = {
    "asis": ("pelvis", "pelvis", (46, 120, 83), 12, 8, "ASIS ASI IAS FWT FRONTWAIST WAISTFRONT"
              " AS SIAS"),
    "psis": ("pelvis", "pelvis", (-105, 45, 83), 15, 8, "PSIS PSI IPS BWT BACKWAIST WAISTBACK PS"
              " SIPS"),
    "iliac_crest": ("pelvis", "pelvis", (-10, 135, 150), 40, 10, "ICR ILC IC ILIACCREST ILIAC"
              " CREST CSI IAC WAIST"),
    "hip_centre": ("pelvis", "_thigh", (0, 0, 0), 10, 8, "HJC HIPCENTRE HIPCENTER HIPJOINT HIPJC"),
    "trochanter": ("_thigh", "_thigh", (0, 85, 0), 30, 15, "GT GTR FTC TROC TROCH GTROC"
              " TROCHANTER GREATERTROCHANTER GTROCHANTER GTRO GRT TRO TRC HIP"),
    "thigh": ("_thigh", "_thigh", (0, 70, -220), 120, 15, "THI THIGH TH THIGHUPPER THIGHFRONT"
              " THIGHREAR THIGHLAT THAP THAD THLD UTHIGH LTHIGH THIGHLOWER THIGHDIST THIGHPROX"
              " QUAD BAR1 WAND1 THIGHFRONTLOW T1 T2 T3 T4 THU THL THD ANTFEM POSTFEM"),
    "knee_lateral": ("_thigh", "_shank", (0, 58, 0), 12, 10, "KNE KNEELAT LATKNEE LKNEE KNEEOUT"
              " KNEE1 LFC FLE LE LEP LK KNEEEXT KNL KNEL LFEP LFE LCON FLC LEK KNEELATEPICONDYLE"
              " FCL LKN LEPI KNJNTLN LATCON"),
    "knee_medial": ("_thigh", "_shank", (0, -58, 0), 12, 10, "MKNEE KNEEMED MEDKNEE KNM KNEM MFC"
              " FME ME MEP MK KNEEIN KNEEINT MFEP MFE MCON FMC MEK KNEEMEDEPICONDYLE FCM MKN KNI"
              " MEPI MEDCON"),
    "knee_centre": ("_thigh", "_shank", (0, 0, 0), 10, 8, "KJC KNEEJOINT KNEECENTRE KNEECENTER"
              " KNEEJC"),
    "fibula_head": ("_shank", "_shank", (-15, 55, -50), 20, 10, "HF FH FAX FIBHEAD FIBULA FIBHD"
              " FIB HFB FIBULAHEAD"),
    "tibial_tuberosity": ("_shank", "_shank", (45, 0, -65), 25, 10, "TT TTC TTUB TTB TIBTUB TUB"
              " TIBIALTUB TTU TIBTUBERCLE TIBIALTUBERCLE TUBTIB ATT"),
    "shank": ("_shank", "_shank", (20, 40, -200), 120, 10, "TIB TIBIA SHANK SHN SHIN SHANKUPPER"
              " SHANKFRONT SHANKREAR SHANKLAT TIAP TIAD TB SK1 SK2 SK3 SK4 LEG CALF BAR2 WAND2"
              " SHA ATI SHINFRONTHIGH SHANKANTSUP S1 S2 S3 S4 TBU TBC TBD ANTTIB POSTTIB SH1 SH2"
              " SH3 SH4 SH5"),
    "ankle_lateral": ("_shank", "_foot", (0, 42, 0), 10, 8, "ANK ANKLELAT LATANKLE LANKLE LMAL"
              " MAL MALL LM FAL ANKLEOUT ANKLEEXT ANL LMA LATMALLEOLUS LATMAL LA LAK LML MALLAT"
              " MALLEOLUSLAT MALLLAT ANKL"),
    "ankle_medial": ("_shank", "_foot", (8, -42, 5), 10, 8, "MANKLE ANKLEMED MEDANKLE MMAL MED"
              " MM TAM ANKLEIN ANKLEINT ANM MMA MEDMALLEOLUS MEDMAL MA MAK MML MALM MALMED"
              " MALLEOLUSMED MALLMED ANKM MAN SPH"),
    "ankle_centre": ("_shank", "_foot", (0, 0, 0), 10, 8, "AJC ANKLEJOINT ANKLECENTRE ANKLECENTER"
              " ANKLEJC"),
    "heel": ("_foot", "_foot", (-65, 0, -55), 25, 6, "HEE HEEL CAL CALC CALCANEUS CA FCC HL HEEL1"
              " HEL PCA HEE1 PHEEL CALCBACK HEELBACK HEELFOOT HEELCENTER"),
    "toe": ("_foot", "_foot", (150, 0, -55), 50, 8, "TOE TOES SMH FM2 SM MT2 TOETIP TOEMID"
              " FOREFOOT MTP TOE2 2META TOECENTER MT3 D2M MH2 FOREFOOT2 TO BIGTOE FOOTINDEX MET2"
              " MET3 3META HALLUX HLX HALL M2 2MET TT2"),
    "metatarsal_1": ("_foot", "_foot", (125, -35, -58), 30, 8, "MT1 FMH FM1 FM TOEMED 1META MTP1"
              " D1M D1MT MH1 1MT 1MTP TOE1 TOEIN FOREFOOTIN FIRSTMETATARSAL FIRSTMET MET1 META1"
              " MTH1 1MTH 1MH 1MET 1STMET M1 MT0 MFH1"),
    "metatarsal_5": ("_foot", "_foot", (105, 50, -65), 30, 8, "MT5 VMH FM5 VM TOELAT 5META MTP5"
              " D5M D5MT MH5 5MT 5MTP TOE5 MET MT5HEAD TOEOUT FOREFOOTOUT FOREFOOT5"
              " FIFTHMETATARSAL SMALLTOE FIFTHMET MET5 META5 MTH5 5MTH 5MH 5MET 5THMET 5TH M5"
              " MFH5"),
    "foot": ("_foot", "_foot", (60, 10, -40), 80, 8, "MIDFOOTSUP MIDFOOTLAT MIDFOOT FOOT P1MT"
              " P5MT P1M P5M FT MIDFOOTMED NAV LCAL MCAL LCALC MCALC STL LCA CUN CUB"),
    "acromion": ("trunk", "_upper_arm", (0, 5, 45), 25, 15, "SHO SHOULDER ACR ACROMION ACROMIUM"
              " AC CAJ ACRO SHLD SHD SAE SAJ SHOULD SHOULDERTOP SH ACROM"),
    "shoulder_centre": ("trunk", "_upper_arm", (0, 0, 0), 15, 12, "SJC SHOULDERCENTRE GHJC"
              " SHOULDERCENTER SHOULDERJOINT SHOULDERJC"),
    "clavicle": ("trunk", "trunk", (65, 30, 380), 40, 10, "CLAVICLE CLA SC SCJ CLAV STERNUM"),
    "scapula": ("trunk", "trunk", (-110, 90, 320), 80, 15, "SCAP BAK SIA SAA SRS SCAPULA ACRB"
              " SCAPINF IAS2 SHOULDERBACK BACK"),
    "upper_arm": ("_upper_arm", "_upper_arm", (0, 45, -150), 90, 12, "UPA BICEP BICEPS UPPERARM"
              " UA UARM ARM HUMERUS UPARM TRICEP TRICEPS DELT UARMHIGH"),
    "elbow_lateral": ("_upper_arm", "_forearm", (0, 38, 0), 15, 10, "ELB ELBOWLAT LATELBOW LELBOW"
              " LEL HLE ELBOWOUT ELBL ELL EL LHE LEE ARMLATEPICONDYLE"),
    "elbow_medial": ("_upper_arm", "_forearm", (0, -38, 0), 15, 10, "MELBOW ELBOWMED MEDELBOW"
              " MEL HME ELBOWIN ELBM ELM EM MHE MEE ARMMEDEPICONDYLE IEL"),
    "elbow_centre": ("_upper_arm", "_forearm", (0, 0, 0), 10, 10, "EJC ELBOWCENTRE ELBOWCENTER"
              " ELBOWJOINT ELBOWJC"),
    "forearm": ("_forearm", "_forearm", (20, 30, -140), 90, 10, "FRM FOREARM FRA FARM FA"
              " FASUPERIOR FORE RADULN"),
    "wrist": ("_forearm", "_hand", (0, 25, 0), 30, 10, "WRIST WRI WR MW LW WRISTOUT WRISTIN OWR"
              " IWR"),
    "wrist_radial": ("_forearm", "_hand", (32, 0, 0), 12, 8, "WRA RSP WRISTRAD WRISTLAT LATWRIST"
              " LWRIST FARADIUS RAD RADIUS RS WRR WRISTRADIUS WRISTTHUMB RADIALSTYLOID"),
    "wrist_ulnar": ("_forearm", "_hand", (-32, 0, 0), 12, 8, "WRB USP WRISTULN WRISTMED MEDWRIST"
              " MWRIST FAULNA ULN ULNA UHE US WRU WRISTULNA WRISTPINKY ULNARSTYLOID"),
    "wrist_centre": ("_forearm", "_hand", (0, 0, 0), 10, 10, "WJC WRISTCENTRE WRISTCENTER"
              " WRISTJOINT WRISTJC"),
    "hand": ("_hand", "_hand", (0, 20, -75), 35, 8, "FIN HAND HM3 HM2 HM5 FIN1 HANDTOP MCP3 MCP2"
              " MC3 MCP5 MCP MC2 MC5 HND HANDOUT TOPOFHAND HANDIN OHAND IHAND HMH2 HMH5"),
    "head_front": ("head", "head", (110, 70, 165), 40, 6, "FHD HDF FRONTHEAD HEADFRONT FH1"
              " FOREHEAD"),
    "head_back": ("head", "head", (-75, 70, 165), 40, 6, "BHD HDB BACKHEAD HEADBACK REARHEAD"),
    "ear": ("head", "head", (15, 75, 125), 30, 6, "EAR TRAGUS TRAG HEAD HD AURICULARIS TEMPLE"),
}  # fmt: skip
_MIDDLE: dict[str, _Row] = {
    "sacrum": ("pelvis", "pelvis", (-110, 0, 75), 20, 8, "SACR SACRUM S2 S1 VSACRAL VSAC SAC MPSIS"
               " SACRAL MIDPSIS WAISTBACK PSIS"),
    "mid_asis": ("pelvis", "pelvis", (46, 0, 83), 12, 8, "MIDASIS"),
    "root": ("pelvis", "pelvis", (0, 0, 20), 30, 8, "PELVISROOT MIDHIP CHIP"),
    "spine_low": ("trunk", "trunk", (-100, 0, 60), 80, 12, "L1 L2 L3 L4 L5 LV1 LV3 LV5 LUMBAR"),
    "spine": ("trunk", "trunk", (-115, 0, 230), 90, 10, "T10 TV10 T8 TV8 T12 TV12 T6 T7 T4 T5 T9"
              " T11 TH5 TH6 TH7 TH8 TH9 TH10 TH11 TH12 THORAX SPINE SPINETHORACIC12"),
    "spine_high": ("trunk", "head", (-60, 0, -50), 40, 10, "T2 TV2 T1 TV1 T3 BACKTOP SPINETOP"
                   " SPINETHORACIC2"),
    "c7": ("trunk", "head", (-55, 0, 0), 15, 10, "C7 CV7 CERV7 C7T1"),
    "jugular": ("trunk", "trunk", (65, 0, 386), 30, 10, "CLAV SJN SNJ IJ SUP JN MANUBRIUM JUG"
                " CLAVICLE SUPR MIDCLAVICLE INCJ SS"),
    "xiphoid": ("trunk", "trunk", (95, 0, 240), 60, 12, "STRN STERNUM SXS PX XIPH XYPH XIPHOID STER"
                " XP CHEST"),
    "back": ("trunk", "trunk", (-110, -70, 300), 90, 12, "RBAK LBAK OFFSET ROFFSET ROFF RSCAP BACK"
             " BBAC BACKOFFSET"),
    "head_top": ("head", "head", (20, 0, 250), 30, 6, "TOPHEAD HEADTOP TOP HDTP VERTEX HTOP HEAD"
                 " THEAD THEA TOPOFHEAD"),
    "head_mid_front": ("head", "head", (120, 0, 165), 40, 6, "FRONTHEAD FOREHEAD HEADFRONT HDFR"
                       " GLAB GLABELLA NASION FHEAD FHEA"),
    "head_mid_back": ("head", "head", (-90, 0, 165), 40, 6, "BACKHEAD REARHEAD HEADBACK HDBK OCC"
              " BACKOFHEAD"),
    "neck_centre": ("trunk", "head", (0, 0, 0), 15, 10, "CJC NECKJOINT NECKCENTRE"),
    "head_centre": ("head", "head", (20, 0, 90), 40, 8, "HEADCENTRE HEADJOINT"),
}  # fmt: skip
_BOTH = ("left", "right")
SIDES = {
    one: side for side in _BOTH for one in (side[0].upper(), side[0].upper() + "X", side.upper())
}
CLUSTER = 3  # markers that determine a segment's rotation
ABOVE = ("head", *(f"{s}_{part}" for s in _BOTH for part in ("upper_arm", "forearm", "hand")))
# Joints of recordings without a marker on the pelvis: cameras see joint centres.
_CENTRES = {
    "trochanter": "hip_centre", "knee_lateral": "knee_centre", "ankle_lateral": "ankle_centre",
    "acromion": "shoulder_centre", "elbow_lateral": "elbow_centre", "wrist": "wrist_centre",
}  # fmt: skip
# Landmarks with several markers on one segment, which are numbered or told apart by these words.
_CLUSTERS = frozenset(("thigh", "shank", "heel", "foot", "upper_arm", "forearm"))
_WHICH = re.compile(
    "TOP|BOTTOM|UP(?!(PER)?ARM)(PER)?|LOWER|LO$|MID|SUP(ERIOR)?|INF(ERIOR)?|PROX(IMAL)?"
    "|DIST(AL)?|ANT(ERIOR)?|POST(ERIOR)?|LAT|MED|FRONT|REAR(?!M)|CLUSTER|CL(?=[0-9])|[0-9]"
)
_SUFFIXES = ("STUDY", "MARKER", "REFERENCE", "SPINALPROCESS")
# Word boundaries in camel case, before a side in lower case behind capitals (SIASr), and between a
# side and a number (KU Leuven's foot_r1); Xsens's p.
_BOUNDARY = re.compile(
    "(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|(?<=[A-Z]{2})(?=[lr]$)|(?<=[ _.][lrLR])(?=[0-9])"
)
_PREFIX = re.compile("^p(?=[A-Z])")
_SHORT = {
    "LATERAL": "LAT", "MEDIAL": "MED", "KNEE": "KNE", "ANKLE": "ANK", "ELBOW": "ELB",
    "UPPERLEG": "THIGH", "LOWERLEG": "SHANK", "LOWERARM": "FOREARM", "METATARSAL": "MET",
    "1STMET": "1MET", "2NDMET": "2MET", "5THMET": "5MET", "GREATERTRO": "GTRO", "GREATTRO": "GTRO",
    "TROCHANTER": "TRO", "TROCH": "TRO",
}  # fmt: skip
_SEPARATED = re.compile("[^ _.:-]+[ _.:-]+(?=.)")  # a label's first word, with what parts it


def _short(word: str) -> str:
    """Return a word with the shorter of two usual spellings, by which landmarks are found."""
    for long, short in _SHORT.items():
        word = word.replace(long, short)
    return word


def _aliases(table: dict[str, _Row]) -> dict[str, str]:
    found = dict[str, str]()
    for name, row in table.items():
        for alias in row[5].split():
            found.setdefault(_short(alias), name)
    return found


_PAIRED_ALIASES, _MIDDLE_ALIASES = _aliases(_PAIRED), _aliases(_MIDDLE)


def landmark_of(label: str) -> str | None:
    """Return the name of a marker label's landmark, or None.

    ``left_asis`` from ``Subject1:LASI``, ``L.ASIS``, ``asis_left`` and the like.
    """
    text = _BOUNDARY.sub(" ", _PREFIX.sub("", label.rpartition(":")[2]))
    parts = re.sub(r"[^A-Z0-9]+", " ", text.upper()).split()
    words = "".join(parts)
    for suffix in _SUFFIXES:
        if words.endswith(suffix):
            words, end = words.removesuffix(suffix), len(words) - len(suffix)
            parts = [part for k, part in enumerate(parts) if len("".join(parts[: k + 1])) <= end]
    if _short(words) in _MIDDLE_ALIASES:
        return _MIDDLE_ALIASES[_short(words)]
    for side in sorted(SIDES, key=len, reverse=True):
        # A side inside a label must be separated: the R of SACR is none.
        separated = len(parts) > 1 and parts.count(side) == 1
        rests = ["".join(part for part in parts if part != side)] if separated else []
        if words.startswith(side):
            rests.append(words.removeprefix(side))
        if len(side) > 1 and words.endswith(side):
            rests.append(words.removesuffix(side))
        for rest in map(_short, rests):
            mark = _PAIRED_ALIASES.get(rest)
            if mark is None and (many := _PAIRED_ALIASES.get(_WHICH.sub("", rest))) in _CLUSTERS:
                mark = many
            if mark is not None:
                return f"{SIDES[side]}_{mark}"
    return None


def landmarks_of(labels: Iterable[str]) -> dict[str, str]:
    """Return the landmarks' names by label, for the labels that have one.

    What most labels begin with, as the subject in ``Anna_LASI``, is left out. With both hips and
    nothing else on the pelvis, joints are taken for their centres.
    """
    plain = without_prefix(tuple(labels))
    found = {label: name for label, rest in plain.items() if (name := landmark_of(rest))}
    on_pelvis = {name for name in found.values() if landmark(name).segment == "pelvis"} - {"root"}
    if on_pelvis or not {"left_trochanter", "right_trochanter"} <= set(found.values()):
        return found
    for label, name in found.items():
        side, _, rest = name.partition("_")
        found[label] = f"{side}_{_CENTRES[rest]}" if rest in _CENTRES else name
    return found


def without_prefix(labels: Sequence[str]) -> dict[str, str]:
    """Return each label without the words before a separator that more than half of them share."""
    plain = {label: label for label in labels}
    while True:
        first = {label: one[0] for label, rest in plain.items() if (one := _SEPARATED.match(rest))}
        word, count = max(Counter(first.values()).items(), key=itemgetter(1), default=("", 0))
        if 2 * count <= len(plain) or word.rstrip(" _.:-").upper() in SIDES:
            return plain
        plain |= {one: plain[one].removeprefix(word) for one, its in first.items() if its == word}


def landmark(name: str) -> Landmark:
    """Return a landmark by its name, as :func:`landmark_of` gives it."""
    side, _, rest = name.partition("_")
    paired = side in ("left", "right")
    row = _PAIRED[rest] if paired else _MIDDLE[name]
    segment, anchor, (x, y, z), spread, noise, _ = row
    sign = -1.0 if side == "right" else 1.0
    carrier, counted = (side + part if part.startswith("_") else part for part in (segment, anchor))
    place = (1e-3 * x, sign * 1e-3 * y, 1e-3 * z)
    return Landmark(name, carrier, counted, place, 1e-3 * spread, 1e-3 * noise)


def missing_landmarks(names: Sequence[str], standing: Iterable[str] = ()) -> list[str]:
    """Return the landmarks of a motion that a fit needs and that are missing, in words.

    A knee or ankle needs a marker beside it, in the motion or, as laboratories remove some for it,
    in a static trial; or three markers on each of its segments, which rotate about it. The trunk
    needs one marker; without any, and none on head and arms, it is guessed. The pelvis may be told
    by both hips and the trunk's joint.

    ``names``: of each marker; those of a cluster are equal.
    ``standing``: landmarks of a static trial.
    """
    found, static, missing = set(names), set(standing), list[str]()
    on = Counter(landmark(name).segment for name in names)
    left, right = ({n.removeprefix(f"{s}_") for n in found if n.startswith(s)} for s in _BOTH)
    hips = "hip_centre" in left & right
    if len({n for n in found if landmark(n).segment == "pelvis"}) < 3 and not hips:
        missing.append("three on the pelvis (RASI, LASI, and RPSI and LPSI, or SACR)")
    if not on["trunk"] and any(one in ABOVE for one in on):
        missing.append("one or more on the trunk (C7, CLAV, STRN, RSHO, LSHO)")
    for side in _BOTH:
        mark = side[0].upper()
        for joint, above, below in (("knee", "thigh", "shank"), ("ankle", "shank", "foot")):
            beside = {f"{side}_{joint}_{part}" for part in ("lateral", "medial", "centre")}
            fewest = min(on[f"{side}_{above}"], on[f"{side}_{below}"])
            if not (found & beside or (fewest and static & beside) or fewest >= CLUSTER):
                label = {"knee": "KNE", "ankle": "ANK"}[joint]
                missing.append(f"the {side} {joint} ({mark}{label})")
        if not on[f"{side}_foot"]:
            missing.append(f"the {side} foot ({mark}TOE, {mark}HEE)")
    return missing


def identifies_trunk(marks: Iterable[Landmark]) -> bool:
    """Whether some markers tell the lean of the trunk, which those low on the back do not."""
    return any(
        one.segment in ABOVE or (one.segment == "trunk" and one.name != "spine_low")
        for one in marks
    )
