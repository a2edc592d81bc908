"""Pictures, and what notebooks show."""

import struct
import zlib

import numpy as np
import pytest
from conftest import SQUARES, SQUARES_FACES

from raybrook import OptionError, Scene


def decoded(png):
    """The bytes of an 8-bit RGB picture without interlacing."""
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    place, parts = 8, {}
    while place < len(png):
        length, kind = struct.unpack(">I4s", png[place : place + 8])
        parts[kind] = parts.get(kind, b"") + png[place + 8 : place + 8 + length]
        place += 12 + length
    width, height, depth, colour = struct.unpack(">IIBB", parts[b"IHDR"][:10])
    assert (depth, colour) == (8, 2)
    lines = np.frombuffer(zlib.decompress(parts[b"IDAT"]), np.uint8).reshape(height, 1 + 3 * width)
    rows = np.zeros((height + 1, width + 1, 3), int)
    for y, line in enumerate(lines):
        for x, given in enumerate(line[1:].reshape(width, 3).astype(int)):
            left, above, corner = rows[y + 1, x], rows[y, x + 1], rows[y, x]
            guess = left + above - corner
            near = np.abs(guess - left), np.abs(guess - above), np.abs(guess - corner)
            paeth = np.where(
                (near[0] <= near[1]) & (near[0] <= near[2]), left, np.where(near[1] <= near[2], above, corner)
            )
            rows[y + 1, x + 1] = (given + [0, left, above, (left + above) // 2, paeth][line[0]]) % 256
    return rows[1:, 1:]


def test_a_picture(squares, tmp_path):
    picture = squares.render(24, 16, samples=4)
    assert (picture.width, picture.height) == (24, 16)
    assert (picture.pixels.shape, picture.pixels.dtype) == ((16, 24, 3), np.float32)
    assert (picture.to_srgb8().shape, picture.to_srgb8().dtype) == ((16, 24, 3), np.uint8)
    assert picture.all_rays >= picture.camera_rays == 24 * 16 * 4
    assert np.array_equal(decoded(picture._repr_png_()), picture.to_srgb8())
    picture.save(tmp_path / "picture.png")
    assert np.array_equal(decoded((tmp_path / "picture.png").read_bytes()), picture.to_srgb8())
    assert "24x16" in repr(picture)


def test_layers(squares, tmp_path):
    camera = {"eye": (2, 2, 9), "target": (2, 2, 0), "samples": 1}
    names = ["depth", "position", "normal", "uv", "primitive", "samples"]
    picture = squares.render(9, 7, **camera, layers=names)
    layers = picture.layers
    assert list(layers) == names
    shapes = {"position": (7, 9, 3), "normal": (7, 9, 3), "uv": (7, 9, 2)}
    assert all(layers[name].shape == shapes.get(name, (7, 9)) for name in names)
    assert {layers[name].dtype.name for name in ("primitive", "samples")} == {"uint32"}
    hit = layers["primitive"] != 2**32 - 1
    assert hit.any() and np.array_equal(hit, np.isfinite(layers["depth"]))
    eye = np.float32([2, 2, 9])
    assert np.allclose((eye - layers["position"])[hit][:, 2], layers["depth"][hit])
    directions = (layers["position"] - eye)[hit]
    hits = squares.closest_hits(np.concatenate([np.broadcast_to(eye, directions.shape), directions], axis=1))
    assert np.array_equal(hits.triangle, layers["primitive"][hit])
    picture.save(tmp_path / "layers.exr")
    assert b"depth.Z" in (tmp_path / "layers.exr").read_bytes()[:900]
    assert squares.render(9, 7, **camera).layers == {}
    for wrong in (["speed"], ["error"]):
        with pytest.raises(OptionError, match=wrong[0]):
            squares.render(9, 7, **camera, layers=wrong)


def test_a_camera(squares):
    picture = squares.render(9, 9, eye=(2, 2, 9), target=(2, 2, 0), fov=20, samples=1)
    away = squares.render(9, 9, eye=(2, 2, 9), target=(2, 2, 99), fov=20, samples=1)
    assert picture.pixels[4, 4].max() < away.pixels[4, 4].max() - 0.1  # before a light background
    for wrong in ({"view": "top", "eye": (1, 2, 3)}, {"width": 3}, {"samples": 1, "error": 1.0}):
        with pytest.raises(TypeError, match="together"):
            squares.render(**wrong)


def test_parts_of_a_camera(squares):
    def pixels(**camera):
        return squares.render(9, 9, samples=1, **camera).pixels

    seen = [
        pixels(),
        pixels(eye=(2, 3, 9)),
        pixels(target=(1, 1, 0)),
        pixels(up=(1, 2, 0)),
        pixels(eye=(2, 3, 9), fov=20),
        pixels(view="top"),
        pixels(view="iso"),
    ]
    for i, picture in enumerate(seen):
        assert not any(np.array_equal(picture, other) for other in seen[:i]), i
    assert np.array_equal(pixels(up="-x"), pixels(up=(-2, 0, 0)))
    with pytest.raises(OptionError, match="no 'above'; possible: front, back"):
        pixels(view="above")
    with pytest.raises(OptionError, match="eye"):
        pixels(eye=(1, 2, 3), target=(1, 2, 3))
    with pytest.raises(ValueError, match="'w' is no axis"):
        pixels(up="w")


def test_a_part_and_an_exposure(squares):
    whole = squares.render(24, 16, samples=4)
    part = squares.render(24, 16, samples=4, crop=(3, 5, 10, 2))
    assert np.array_equal(part.pixels, whole.pixels[5:7, 3:13])
    assert np.array_equal(part.exposed(-2).pixels, part.pixels / 4)
    for wrong in ({"crop": (20, 0, 5, 1)}, {"crop": (0, 0, 0, 1)}):
        with pytest.raises(OptionError, match="crop"):
            squares.render(24, 16, **wrong)
    with pytest.raises(OptionError, match="exposure"):
        part.exposed(float("nan"))


def test_a_scene_shows_itself():
    scene = Scene(SQUARES, SQUARES_FACES)
    preview = scene.preview()
    assert (preview.width, preview.height) == (320, 240)
    assert scene._repr_png_() == preview._repr_png_()
