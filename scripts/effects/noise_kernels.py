"""How noise is correlated from pixel to pixel: the kernel whose convolution with white noise is like it."""

import numpy as np

REACH = 8  # pixels from the middle, to which kernels are kept: a codec's block sees no farther
SAME_GAIN = 1e-3  # by which gains differ that are one
LEVELS = 3  # of noise in an image, between which gains are interpolated


def centred(kernel, side):
    """Return a kernel (n, n) in an odd square (side, side), zeros about it where it is smaller, its middle where it is larger.

    Of even n its middle is the first pixel of the second half.
    """
    out = np.zeros((side, side))
    start = side // 2 - len(kernel) // 2
    own = slice(max(-start, 0), max(-start, 0) + side)
    inner = kernel[own, own]
    there = slice(max(start, 0), max(start, 0) + len(inner))
    out[there, there] = inner
    return out


def convolved(first, second):
    """Return the whole convolution (n + m - 1, n + m - 1) of kernels (n, n) and (m, m)."""
    size = 2 * (len(first) + len(second) - 1,)
    return np.fft.irfft2(np.fft.rfft2(first, size) * np.fft.rfft2(second, size), size)


def followed(before, kernel):
    """Return (by what noise with a kernel ``before``, None where it is white, grows in another, the kernel of what comes out).

    None for that where nothing does.
    """
    both = kernel if before is None else convolved(before, kernel)
    gain = float(np.sqrt((both**2).sum()))
    both = centred(both, 2 * REACH + 1)
    return gain, both / np.sqrt((both**2).sum()) if gain else None


def processed(noise_dn, before, kernel_of):
    """Return (noise_dn, kernel) of noise, a number or an array, after an effect; ``kernel_of`` takes its kernel of a number.

    Uneven noise has the kernel of its root mean square.
    """
    if np.ndim(noise_dn) == 0:
        gain, kernel = followed(before, kernel_of(float(noise_dn)))
        return noise_dn * gain, kernel
    levels = np.linspace(noise_dn.min(), noise_dn.max(), LEVELS)
    gains = [followed(before, kernel_of(float(level)))[0] for level in levels]
    after = followed(before, kernel_of(float(np.sqrt(np.mean(np.square(noise_dn))))))[1]
    if np.ptp(gains) < SAME_GAIN:
        return noise_dn * np.float32(gains[0]), after
    return noise_dn * np.interp(noise_dn, levels, gains).astype(np.float32), after


def with_white(kernel, share):
    """Return the kernel (n, n) of noise of which a share of the variance has a kernel (n, n), n odd, and the rest is white."""
    power = share * np.abs(np.fft.fft2(kernel)) ** 2 + 1 - share
    return np.fft.fftshift(np.fft.ifft2(np.sqrt(power)).real)


def correlations(kernel, lags):
    """Return the correlations (2 lags + 1, 2 lags + 1) of noise with a kernel, the middle one 1; None is white."""
    if kernel is None:
        kernel = np.ones((1, 1))
    kernel = kernel / np.sqrt((kernel**2).sum())
    return centred(convolved(kernel, kernel[::-1, ::-1]), 2 * lags + 1)
