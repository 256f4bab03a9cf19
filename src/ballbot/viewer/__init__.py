"""The view: logs of balancing robots in three dimensions, as a page that opens in any browser without a network.

motion     what a log shows, at even times: pose, the ball's rotation, wheels, friction, signals to plot
packing    columns as few bytes of text
page       the page with picture, controls and plots, whole or as a part of another page

`web/` has the page's own code: `linear`, `meshes`, `renderer` (WebGL 2), `runs`, `camera`, `scene`, `plots` and
`replay`, which use one another in that order, and the style sheets; and uPlot, which draws time series.
"""

from ballbot.viewer.page import Layout as Layout
from ballbot.viewer.page import replay_page as replay_page
from ballbot.viewer.page import replay_part as replay_part
