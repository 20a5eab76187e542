"""The live viewer: a robot and its controller in a web browser, by viser in a process of its own.

    control process                        page process
    Viewer.update -> latest -> sender ---> Page: recording, layers, panel --> browsers
    TargetControls (targets, weights) <--------- sliders, dragged targets, buttons

The control loop pays for storing one reference per tick; everything that is drawn is computed by
the page's process. It builds frames at its own pace and drops those it has no time for.
"""
