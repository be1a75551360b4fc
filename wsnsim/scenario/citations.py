"""The papers, books and standards that kinds name as their sources, with titles and DOIs.

cited_in("Jiang, Song, Lin (2013), eq. 1-4") -> [Citation(...)]
"""

from __future__ import annotations

from typing import Final, NamedTuple

NOT_LOOKED_UP: Final = "not looked up"
"""The mark of a DOI that was not compared with the record at doi.org."""


class Citation(NamedTuple):
    """A publication that the code cites.

    Attributes:
        key: how the code cites it.
        title: its title.
        venue: where it appeared.
        doi: its DOI; '' if none could be verified.
        looked_up: whether the DOI was compared with the record at doi.org.
    """

    key: str
    title: str
    venue: str
    doi: str = ""
    looked_up: bool = True

    @property
    def mark(self) -> str:
        """The words that follow a DOI which was not looked up; '' for all others."""
        return "" if self.looked_up else f" ({NOT_LOOKED_UP})"

    def text(self) -> str:
        """Return the citation in one line."""
        return f"{self.key}: {self.title}. {self.venue}." + (f" doi:{self.doi}{self.mark}" if self.doi else "")


CITATIONS: Final = (
    Citation("Jiang, Song, Lin (2013)",
        "Target tracking algorithm for wireless sensor networks based on particle swarm optimization and "
        "Metropolis-Hasting sampling particle filter", "Journal on Communications 34(11), 8-17 (in Chinese)"),
    Citation("Liu, Wang (2012)", "Interacting multiple sensor filter for sensor networks",
        "Acta Electronica Sinica 40(4), 724-728 (in Chinese)", "10.3969/j.issn.0372-2112.2012.04.016"),
    Citation("Wei, Guo (2022)", "WSN target tracking based on improved cuckoo particle filter algorithm",
        "Computer Measurement & Control 30(7), 273-279, 291 (in Chinese)"),
    Citation("Ruan, Wang, Yang, Zhang (2020)",
        "Research on an indoor node tracking algorithm based on improved Gaussian particle filter",
        "Journal of Shijiazhuang Tiedao University (Natural Science Edition) 33(3), 116-121 (in Chinese)",
        "10.13319/j.cnki.sjztddxxbzrb.20190060"),
    Citation("Li, Jiang, Zhang, Zhang (2012)", "GM(1,1) based target tracking algorithm in wireless sensor networks",
        "Journal of Software 23(Suppl. 1), 149-158 (in Chinese)"),
    Citation("Ren, Li, Gao, Cheng (2009)",
        "A two-phase sleep scheduling based protocol for target tracking in sensor networks",
        "Chinese Journal of Computers 32(10), 1971-1979 (in Chinese)"),
    Citation("Yang, Xing, Shi, Pan (2007)",
        "Dynamic collaborative algorithm for maneuvering target tracking in sensor networks",
        "Acta Automatica Sinica 33(10), 1029-1035 (in Chinese)"),
    Citation("Arasaratnam, Haykin (2009)", "Cubature Kalman filters", "IEEE Trans. Automatic Control 54(6)",
        "10.1109/TAC.2009.2019800"),
    Citation("Avvenuti, Corsini, Masci, Vecchio (2006)",
        "Increasing the efficiency of preamble sampling protocols for wireless sensor networks", "MCWC"),
    Citation("Bar-Shalom, Li, Kirubarajan (2001)", "Estimation with Applications to Tracking and Navigation", "Wiley",
        "10.1002/0471221279"),
    Citation("Bell, Cathey (1993)", "The iterated Kalman filter update as a Gauss-Newton method",
        "IEEE Trans. Automatic Control 38(2)", "10.1109/9.250476"),
    Citation("Blom, Bar-Shalom (1988)",
        "The interacting multiple model algorithm for systems with Markovian switching coefficients",
        "IEEE Trans. Automatic Control 33(8)", "10.1109/9.1299"),
    Citation("Buettner, Yee, Anderson, Han (2006)",
        "X-MAC: a short preamble MAC protocol for duty-cycled wireless sensor networks", "SenSys",
        "10.1145/1182807.1182838"),
    Citation("Dunkels (2011)", "The ContikiMAC radio duty cycling protocol", "SICS Technical Report T2011:13"),
    Citation("Elliott (1963)", "Estimates of error rates for codes on burst-noise channels",
        "Bell System Technical Journal 42(5)", "10.1002/j.1538-7305.1963.tb00955.x"),
    Citation("Gilbert (1960)", "Capacity of a burst-noise channel", "Bell System Technical Journal 39(5)",
        "10.1002/j.1538-7305.1960.tb03959.x"),
    Citation("Gnawali, Fonseca, Jamieson, Moss, Levis (2009)", "Collection tree protocol", "SenSys",
        "10.1145/1644038.1644040"),
    Citation("Gudmundson (1991)", "Correlation model for shadow fading in mobile radio systems",
        "Electronics Letters 27(23)", "10.1049/el:19911328"),
    Citation("Heinzelman (2000)", "Energy-efficient communication protocol for wireless microsensor networks",
        "Heinzelman, Chandrakasan, Balakrishnan, HICSS-33", "10.1109/HICSS.2000.926982"),
    Citation("Heinzelman (2002)", "An application-specific protocol architecture for wireless microsensor networks",
        "Heinzelman, Chandrakasan, Balakrishnan, IEEE Trans. Wireless Communications 1(4)", "10.1109/TWC.2002.804190"),
    Citation("IEEE 802.15.4-2006", "Wireless MAC and PHY specifications for low-rate WPANs", "IEEE Std 802.15.4-2006",
        "10.1109/IEEESTD.2006.232110"),
    Citation("IEEE 802.15.4-2015", "IEEE standard for low-rate wireless networks", "IEEE Std 802.15.4-2015",
        "10.1109/IEEESTD.2016.7460875"),
    Citation("Johnson, Maltz (1996)", "Dynamic source routing in ad hoc wireless networks", "Mobile Computing, Kluwer",
        "10.1007/978-0-585-29603-6_5"),
    Citation("Joshi, Boyd (2009)", "Sensor selection via convex optimization", "IEEE Trans. Signal Processing 57(2)",
        "10.1109/TSP.2008.2007095"),
    Citation("Julier, Uhlmann (2004)", "Unscented filtering and nonlinear estimation", "Proc. IEEE 92(3)",
        "10.1109/JPROC.2003.823141"),
    Citation("Karp, Kung (2000)", "GPSR: greedy perimeter stateless routing for wireless networks", "MobiCom",
        "10.1145/345910.345953"),
    Citation("Kumar, Lai, Balogh (2004)", "On k-coverage in a mostly sleeping sensor network", "MobiCom",
        "10.1145/1023720.1023735", looked_up=False),
    Citation("Le Boudec, Vojnovic (2005)", "Perfect simulation and stationarity of a class of mobility models",
        "INFOCOM"),
    Citation("Liang, Haas (2003)",
        "Predictive distance-based mobility management for multidimensional PCS networks",
        "IEEE/ACM Trans. Networking 11(5)", "10.1109/TNET.2003.815301"),
    Citation("Mardia, Jupp (2000)", "Directional statistics", "Wiley", "10.1002/9780470316979"),
    Citation("Maróti, Kusy, Simon, Lédeczi (2004)", "The flooding time synchronization protocol", "SenSys",
        "10.1145/1031495.1031501"),
    Citation("Navidi, Camp (2004)", "Stationary distributions for the random waypoint mobility model",
        "IEEE Trans. Mobile Computing 3(1)", "10.1109/TMC.2004.1261820", looked_up=False),
    Citation("RFC 6206", "The Trickle algorithm", "IETF, 2011", "10.17487/RFC6206"),
    Citation("RFC 8180", "Minimal IPv6 over the TSCH mode of IEEE 802.15.4e (6TiSCH) configuration", "IETF, 2017",
        "10.17487/RFC8180"),
    Citation("RFC 8480", "6TiSCH operation sublayer (6top) protocol (6P)", "IETF, 2018", "10.17487/RFC8480"),
    Citation("Wan, van der Merwe (2000)", "The unscented Kalman filter for nonlinear estimation", "AS-SPCC",
        "10.1109/ASSPCC.2000.882463"),
    Citation("Zhao, Shin, Reich (2002)", "Information-driven dynamic sensor collaboration",
        "IEEE Signal Processing Magazine 19(2)", "10.1109/79.985685"),
    Citation("Zuniga, Krishnamachari (2004)", "Analyzing the transitional region in low power wireless links", "SECON",
        "10.1109/SAHCN.2004.1381954", looked_up=False),
)  # fmt: skip
OTHER_FORMS: Final = {
    "Heinzelman, Chandrakasan, Balakrishnan (2002)": "Heinzelman (2002)",
    "Heinzelman and others (2000)": "Heinzelman (2000)",
    "Jiang, Song, Lin 2013": "Jiang, Song, Lin (2013)",
    "Jiang et al. (2013)": "Jiang, Song, Lin (2013)",
}
"""Other forms in which the code cites a publication."""


def cited_in(text: str) -> list[Citation]:
    """Return the publications that a text cites, in the order of their first places."""
    words = " ".join(text.split())
    for form, key in OTHER_FORMS.items():
        words = words.replace(form, key)
    places = {one: words.find(one.key) for one in CITATIONS}
    return sorted((one for one, place in places.items() if place >= 0), key=lambda one: places[one])
