"""Drawing tensors, with autograd. Imported only where there is torch."""

from __future__ import annotations

from typing import Any, Dict, Mapping, Optional, Sequence, Tuple

import numpy as np
import torch

from . import _splatweaver
from ._errors import InputError
from ._rasterization import Request, no_splats, planes_of, rows


class _Rasterize(torch.autograd.Function):
    """The drawing as one operation; `means2d` receives the gradients with respect to projected means."""

    @staticmethod
    def forward(ctx: Any, request: Request, at: slice, means2d: Any, *tensors: Any) -> Tuple[Any, ...]:
        arrays = tuple(tensor.detach().numpy() for tensor in tensors)
        planes = planes_of(tensors, request)
        views = tuple(None if plane is None else plane.numpy() for plane in planes)
        drawing = _splatweaver.rasterize(arrays, views, request.settings)
        request.drawings.append((at, drawing))
        ctx.save_for_backward(*tensors)
        ctx.drawing, ctx.request, ctx.at = drawing, request, at
        ctx.set_materialize_grads(False)
        return planes

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, *cotangents: Any) -> Tuple[Any, ...]:
        if all(gradient is None for gradient in cotangents):
            return (None,) * len(ctx.needs_input_grad)
        arrays = tuple(tensor.detach().numpy() for tensor in ctx.saved_tensors)
        given = tuple(None if gradient is None else gradient.contiguous().numpy() for gradient in cotangents)
        _, _, screen, *wanted = ctx.needs_input_grad
        gradients = tuple(torch.empty_like(tensor) if want else None for tensor, want in zip(ctx.saved_tensors, wanted))
        into = tuple(None if gradient is None else gradient.numpy() for gradient in gradients)
        request, at = ctx.request, ctx.at
        # The sums of an earlier pass, before this one takes their place.
        settle(request, [at.start])
        ctx.drawing.backward(arrays, given, into, request.absgrad)
        centers: Optional[torch.Tensor] = None
        if screen and request.watched:
            means2d = request.splats[0]
            plain, absolute = ctx.drawing.screen_gradients()
            shape = rows(means2d, 2)[at].shape
            centers = torch.from_numpy(plain).reshape(shape)
            if absolute is not None:
                # Sums over backward passes, as .grad does.
                if not hasattr(means2d, "absgrad"):
                    means2d.absgrad = torch.zeros_like(means2d, requires_grad=False)
                rows(means2d.absgrad, 2)[at] += torch.from_numpy(absolute).reshape(shape)
        elif screen:
            request.pending[at.start] = (at, ctx.drawing)
        return (None, None, centers, *gradients)


def settle(request: Request, firsts: Sequence[int]) -> None:
    """Adds the gradients of projected means that wait, of the drawings that begin with these cameras."""
    means2d = request.splats[0]
    for first in firsts:
        if first in request.pending:
            at, drawing = request.pending.pop(first)
            if means2d.grad is None:
                means2d.grad = torch.zeros_like(means2d, requires_grad=False)
            place = rows(means2d.grad, 2)[at]
            place += torch.from_numpy(drawing.screen_gradients()[0]).reshape(place.shape)


def taken(arrays: Mapping[str, Any]) -> Dict[str, Any]:
    """Tensors of one number type, that of the means, on the CPU."""
    means = arrays["means"]
    wanted = means.dtype if isinstance(means, torch.Tensor) else torch.from_numpy(np.asarray(means)).dtype
    if wanted not in (torch.float32, torch.float64):
        raise InputError(f"means: expected float32 or float64, found {str(wanted).replace('torch.', '')}")
    found: Dict[str, Any] = {}
    for name, array in arrays.items():
        tensor = array if isinstance(array, torch.Tensor) else torch.from_numpy(np.asarray(array)).to(wanted)
        if tensor.device.type != "cpu":
            raise InputError(f"{name}: expected a tensor on the CPU, found one on {tensor.device}; .cpu() moves it")
        if tensor.dtype != wanted:
            kinds = [str(kind).replace("torch.", "") for kind in (wanted, tensor.dtype)]
            raise InputError(f"{name}: expected {kinds[0]}, the number type of means, found {kinds[1]}")
        found[name] = tensor
    return found


def zeros(shape: Tuple[int, ...], like: Any) -> Any:
    return torch.zeros(shape, dtype=like.dtype)


def empty(shape: Tuple[int, ...], like: Any) -> Any:
    return torch.empty(shape, dtype=like.dtype)


def fill(splats: Tuple[Any, Any, Any], at: slice, drawn: Tuple[Any, ...]) -> None:
    for kept, numbers, rank in zip(splats, drawn, (2, 2, 1)):
        place = rows(kept.data, rank)[at]
        place.copy_(torch.from_numpy(numbers).reshape(place.shape))


def joined(parts: Sequence[Any]) -> Any:
    return torch.cat(list(parts))


def unseen(arrays: Mapping[str, Any]) -> Tuple[Any, Any, Any]:
    """Projected means, a leaf where anything is differentiated, radii and depths before anything is drawn.

    The zeros are numpy's, which come from the system with the memory. Those of torch are written by its threads, which wait in a loop
    afterwards and keep the rasterizer's from the processors.
    """
    means2d, radii, depths = (torch.from_numpy(part) for part in no_splats(arrays, arrays["means"].detach().numpy().dtype))
    differentiated = torch.is_grad_enabled() and any(tensor.requires_grad for tensor in arrays.values())
    return means2d.requires_grad_(differentiated), radii, depths


def side_by_side(planes: Sequence[Any]) -> Any:
    return torch.cat(list(planes), dim=-1)


def at_least(array: Any, least: float) -> Any:
    return array.clamp(min=least)


def draw(arrays: Tuple[Any, ...], request: Request, at: slice) -> Tuple[Any, ...]:
    tensors = (tensor.contiguous() for tensor in arrays)
    means2d = rows(request.splats[0], 2)
    drawn: Tuple[Any, ...] = _Rasterize.apply(request, at, means2d[at], *tensors)
    return drawn
