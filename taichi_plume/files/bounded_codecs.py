"""Codecs of Zarr that decode a chunk to no more than the size in the array's metadata.

A chunk of 200 KB may decode to gigabytes (decompression bomb): other codecs trust the size that the chunk states, or
decode until the memory is full. Arrays opened in a block of `zarr.config.set(BOUNDED)` use these codecs.
"""

import asyncio
import math
import zlib
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numcodecs
from zarr.abc.codec import Codec
from zarr.codecs import BloscCodec, GzipCodec, ShardingCodec, ZstdCodec
from zarr.codecs._v2 import V2Codec
from zarr.core.array_spec import ArraySpec
from zarr.core.buffer import Buffer, NDBuffer
from zarr.core.codec_pipeline import BatchedCodecPipeline
from zarr.registry import register_pipeline

SLACK = 1 << 16  # bytes over twice the declared size: checksums, shard indices, data packed twice
SIZE_AT = {"blosc": 4, "lz4": 0}  # offset of the decoded size, which the codec writes into packed data


def unpack(codec: str, packed: bytes, most: int) -> bytes:
    """Decompress bytes by the named codec. Raises ValueError for more than `most` bytes, and errors of the codec."""
    if codec in SIZE_AT:
        size = int.from_bytes(packed[SIZE_AT[codec] :][:4], "little")
        data = numcodecs.get_codec({"id": codec}).decode(packed) or b"" if size <= most else b""
    elif codec == "zlib":
        try:
            data = zlib.decompressobj().decompress(packed, most + 1)
        except zlib.error as error:
            raise ValueError(str(error)) from None
        size = len(data)
    else:
        import pyarrow

        data = pyarrow.CompressedInputStream(pyarrow.BufferReader(packed), codec).read(most + 1)
        size = len(data)
    if size > most:
        raise ValueError(f"a chunk decodes to more than is declared, and than {most} bytes")
    return data


async def _unpacked(codec: str, chunk: Buffer, spec: ArraySpec) -> Buffer:
    """Decode a chunk to a buffer of Zarr."""
    most = 2 * math.prod(spec.shape) * spec.dtype.to_native_dtype().itemsize + SLACK
    data = await asyncio.to_thread(unpack, codec, chunk.to_bytes(), most)
    return spec.prototype.buffer.from_bytes(data)


def _subclass(base: type[Any], codec: str) -> type[Any]:
    """Return a subclass of a Zarr 3 codec that refuses to decode a chunk beyond the declared size."""

    async def decode(_self: Codec, chunk_bytes: Buffer, chunk_spec: ArraySpec) -> Buffer:
        return await _unpacked(codec, chunk_bytes, chunk_spec)

    return type(base.__name__, (base,), {"_decode_single": decode, "__module__": __name__})


class Sharding(ShardingCodec):
    """Sharding codec of Zarr 3 whose inner chunks are decoded by the bounded codecs of this module."""

    @property
    def codec_pipeline(self) -> "BoundedPipeline":
        """Bounded decoding pipeline for the chunks within a shard."""
        return BoundedPipeline.from_codecs(self.codecs)


class Zarr2(V2Codec):
    """Codec of Zarr 2 with bounded decompression. The accepted filters do not change the size."""

    async def _decode_single(self, chunk_bytes: Buffer, chunk_spec: ArraySpec) -> NDBuffer:
        if self.compressor is None:
            return await super()._decode_single(chunk_bytes, chunk_spec)
        data = await _unpacked(self.compressor.codec_id, chunk_bytes, chunk_spec)
        return await replace(self, compressor=None)._decode_single(data, chunk_spec)


BASES: dict[type[Codec], str] = {BloscCodec: "blosc", ZstdCodec: "zstd", GzipCodec: "gzip"}
OWN = {ShardingCodec: Sharding} | {base: _subclass(base, codec) for base, codec in BASES.items()}


class BoundedPipeline(BatchedCodecPipeline):
    """Zarr codec pipeline in which each decompressing codec is replaced by its bounded subclass."""

    @classmethod
    def from_codecs(cls, codecs: Iterable[Codec], *, batch_size: int | None = None) -> "BoundedPipeline":
        """Return the pipeline of these codecs, each replaced by its bounded subclass."""
        return super().from_codecs([_bounded(codec) for codec in codecs], batch_size=batch_size)


def _bounded(codec: Codec) -> Codec:
    if type(codec) is V2Codec:
        return Zarr2(filters=codec.filters, compressor=codec.compressor)
    return OWN[type(codec)].from_dict(codec.to_dict()) if type(codec) in OWN else codec


register_pipeline(BoundedPipeline)
BOUNDED = {"codec_pipeline.path": f"{__name__}.{BoundedPipeline.__qualname__}"}
