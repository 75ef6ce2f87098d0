//! A reverse-mode tape of Op values over pooled buffers, generic over f32 and f64, with a gradient checker.
