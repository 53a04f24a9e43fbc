"""Codecs of Zarr that decode a chunk to no more than the size that the array's metadata declare.

A chunk of 200 KB may decode to gigabytes (decompression bomb): codecs believe what the chunk says of its size, or
decode until the memory ends. `zarr.config.set(BOUNDED)` makes the arrays that are opened in its block use these codecs.
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
from zarr.core.codec_pipeline import BatchedCodecPipeline
from zarr.registry import register_pipeline

SLACK = (
    1 << 16
)  # bytes more than twice the declared size: of checksums, shard indices, and packing what is packed
SIZE_AT = {
    "blosc": 4,
    "lz4": 0,
}  # where the first bytes of packed data state the decoded size, which the codec keeps


def unpack(codec: str, packed: bytes, most: int) -> Any:
    """Return unpacked bytes. Raises ValueError if there are more than `most`, and what the codec raises."""
    if codec in SIZE_AT:
        size = int.from_bytes(packed[SIZE_AT[codec] :][:4], "little")
        data = numcodecs.get_codec({"id": codec}).decode(packed) if size <= most else b""
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


async def _unpacked(codec: str, chunk: Any, spec: Any) -> Any:
    """Decode a chunk, as a buffer of Zarr."""
    most = 2 * math.prod(spec.shape) * spec.dtype.to_native_dtype().itemsize + SLACK
    data = await asyncio.to_thread(unpack, codec, chunk.to_bytes(), most)
    return spec.prototype.buffer.from_bytes(data)


class Blosc(BloscCodec):
    """Blosc codec of Zarr 3."""

    async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        return await _unpacked("blosc", chunk_bytes, chunk_spec)


class Zstd(ZstdCodec):
    """Zstandard codec of Zarr 3."""

    async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        return await _unpacked("zstd", chunk_bytes, chunk_spec)


class Gzip(GzipCodec):
    """Gzip codec of Zarr 3."""

    async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        return await _unpacked("gzip", chunk_bytes, chunk_spec)


class Sharding(ShardingCodec):
    """Shards of Zarr 3, whose chunks are decoded by these codecs too."""

    @property
    def codec_pipeline(self) -> "BoundedPipeline":
        """Pipeline of the chunks within a shard."""
        return BoundedPipeline.from_codecs(self.codecs)


class Zarr2(V2Codec):
    """Compressor and filters of Zarr 2. The filters that are read do not change the size."""

    async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        if self.compressor is None:
            return await super()._decode_single(chunk_bytes, chunk_spec)
        data = await _unpacked(self.compressor.codec_id, chunk_bytes, chunk_spec)
        return await replace(self, compressor=None)._decode_single(data, chunk_spec)


OWN: dict[type[Any], type[Any]] = {
    BloscCodec: Blosc,
    ZstdCodec: Zstd,
    GzipCodec: Gzip,
    ShardingCodec: Sharding,
}


class BoundedPipeline(BatchedCodecPipeline):
    """Pipeline in which each codec that may enlarge a chunk is replaced by its bounded subclass."""

    @classmethod
    def from_codecs(cls, codecs: Iterable[Codec], *, batch_size: int | None = None) -> "BoundedPipeline":
        """Return the pipeline of these codecs."""
        return super().from_codecs([_bounded(one) for one in codecs], batch_size=batch_size)


def _bounded(codec: Any) -> Codec:
    if type(codec) is V2Codec:
        return Zarr2(filters=codec.filters, compressor=codec.compressor)
    return OWN[type(codec)].from_dict(codec.to_dict()) if type(codec) in OWN else codec


register_pipeline(BoundedPipeline)
BOUNDED = {"codec_pipeline.path": f"{__name__}.{BoundedPipeline.__qualname__}"}
